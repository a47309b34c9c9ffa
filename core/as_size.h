// as_size turns a count or an index into the type that the standard containers take.
#pragma once

#include <cstddef>
#include <cstdint>

namespace curlew {

/// n must not be negative.
constexpr std::size_t as_size(std::int64_t n) noexcept { return static_cast<std::size_t>(n); }

}  // namespace curlew
