// The sizes that a stage relies on, checked once where it begins.
#pragma once

namespace curlew {

/// Rows and columns of a frame or of a map of lenslets or cells.
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

/// A stage calls it for each of its inputs and outputs. Buffers are made by the plan that they are
/// used with, so that a difference is a mistake in the program and never one in its input. Going
/// on would read or write memory of somebody else, therefore the program ends.
inline void check_size(const char* stage, const char* what, MapSize is, MapSize must_be) noexcept {
  if (is != must_be) [[unlikely]]
    end_for_size(stage, what, is, must_be);
}

}  // namespace curlew
