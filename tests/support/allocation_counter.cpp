#include "tests/support/allocation_counter.h"

#include <cstddef>

namespace curlew {

std::atomic<bool> counting{false};
std::atomic<long> allocations{0};

namespace {
thread_local bool counting_here = false;
thread_local long allocations_here = 0;
}  // namespace

long allocations_of_this_thread(const std::function<void()>& act) {
  allocations_here = 0;
  counting_here = true;
  act();
  counting_here = false;
  return allocations_here;
}

namespace {
[[maybe_unused]] void count() {
  if (counting.load(std::memory_order_relaxed)) ++allocations;
  if (counting_here) ++allocations_here;
}
}  // namespace

}  // namespace curlew

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  curlew::count();
  return __libc_malloc(size);
}
void* calloc(std::size_t n, std::size_t size) {
  curlew::count();
  return __libc_calloc(n, size);
}
void* realloc(void* old, std::size_t size) {
  curlew::count();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  curlew::count();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  curlew::count();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  curlew::count();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? 12 : 0;
}
}
#endif
