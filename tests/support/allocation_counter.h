// This counts mallocs. A test that includes it must link tests/support/allocation_counter.cpp,
// which replaces malloc.
#pragma once

#include <atomic>
#include <functional>

namespace curlew {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kCountsAllocations = false;  // The sanitizer owns malloc.
#else
inline constexpr bool kCountsAllocations = true;
#endif

/// While `counting` is true, the allocations of every thread are added to `allocations`.
extern std::atomic<bool> counting;
extern std::atomic<long> allocations;

/// Returns how often the calling thread, and no other, allocates while it runs `act`.
long allocations_of_this_thread(const std::function<void()>& act);

}  // namespace curlew
