// This file checks the sizes that a stage relies on, once where it begins.
#pragma once

namespace curlew {

/// Holds the rows and columns of a frame, or of a map of lenslets or cells.
struct MapSize {
  int rows = 0;
  int cols = 0;
  bool operator==(const MapSize&) const = default;
};

template <typename Map>
MapSize size_of(const Map& map) noexcept {
  return {map.rows(), map.cols()};
}

/// Ends the program with a sentence that names both sizes.
[[noreturn]] void end_for_size(const char* stage, const char* what, MapSize is,
                               MapSize must_be) noexcept;

/// Ends the program if a size is not what it must be. A stage calls it for each of its inputs and
/// outputs. Buffers are made by the plan that they are used with, so a difference is a mistake in
/// the program and never one in its input. To go on would mean to read or write foreign memory.
inline void check_size(const char* stage, const char* what, MapSize is, MapSize must_be) noexcept {
  if (is != must_be) [[unlikely]]
    end_for_size(stage, what, is, must_be);
}

}  // namespace curlew
