// Says whether the tests run under a sanitizer, which takes ten times as long.
#pragma once

namespace curlew {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

}  // namespace curlew
