// as_size: a count or an index as the standard containers take it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace curlew {

/// n must not be negative.
constexpr std::size_t as_size(std::int64_t n) noexcept { return static_cast<std::size_t>(n); }

}  // namespace curlew
