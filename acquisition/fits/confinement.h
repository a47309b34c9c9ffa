// This takes from a process what it does not need to unpack pixels.
#pragma once

namespace curlew {

// Sanitizers map terabytes and call what the confinement forbids.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kIsSanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool kIsSanitized = true;
#else
constexpr bool kIsSanitized = false;
#endif
#else
constexpr bool kIsSanitized = false;
#endif

/// From now on the kernel lets this process read and write what it has open, take memory and end;
/// anything else, as opening a file or starting a program, is an error (seccomp). It does nothing
/// under a sanitizer and on processors other than x86-64 and AArch64.
void confine_to_open_files();

}  // namespace curlew
