#include "centroiding/cell_sample.h"

#include <cmath>

#include "core/as_size.h"
#include "core/size_check.h"

namespace curlew {

void sample_cells(const Centroids& centroids, const SlopeField& slopes,
                  CellSample& sample) noexcept {
  check_size("sample_cells", "centroids", size_of(centroids.state), size_of(slopes.x));
  sample.n = 0;
  const std::size_t rows = as_size(slopes.rows()), cols = as_size(slopes.cols());
  if (rows < 2 || cols < 2) return;
  const std::size_t cells = (rows - 1) * (cols - 1);
  const std::size_t stride = (cells - 1) / CellSample::kMost + 1;
  const auto is_valid = [&](std::size_t k) {
    return centroids.state[k] == LensletState::kValid ? 1U : 0U;
  };
  for (std::size_t r = 0; r + 1 < rows; ++r) {
    // The sample begins a cell further on in each row, so that it is spread over all columns.
    for (std::size_t c = (r * (cols - 1) + r) % stride;
         c + 1 < cols && sample.n < CellSample::kMost; c += stride) {
      const std::size_t a = r * cols + c, b = a + 1, d = a + cols, e = d + 1;
      sample.lenslet[sample.n] = a;
      sample.circulation_rad[sample.n] =
          0.5F * (slopes.x[a] + slopes.x[b] + slopes.y[b] + slopes.y[e] - slopes.x[d] -
                  slopes.x[e] - slopes.y[a] - slopes.y[d]);
      sample.n += is_valid(a) & is_valid(b) & is_valid(d) & is_valid(e);
    }
  }
}

float sigmas_from_half(std::size_t count, std::size_t n) noexcept {
  const auto all = static_cast<float>(n);
  return (2.0F * static_cast<float>(count) - all) / std::sqrt(all);
}

}  // namespace curlew
