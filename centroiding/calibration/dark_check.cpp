#include "centroiding/calibration/dark_check.h"

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "centroiding/calibration/lenslet_grid_finder.h"
#include "centroiding/calibration/photon_transfer.h"
#include "centroiding/calibration/sentence.h"
#include "centroiding/calibration/spot_picture.h"
#include "core/error.h"

namespace curlew {
namespace {

std::vector<float> finite_values(const Image<float>& image) {
  std::vector<float> values;
  for (const float v : image) {
    if (std::isfinite(v)) values.push_back(v);
  }
  return values;
}

/// Returns the medians of 8×8 parts of the frame.
std::vector<float> levels_of_parts(const Image<float>& image) {
  constexpr int kParts = 8;
  std::vector<float> levels;
  for (int i = 0; i < kParts; ++i) {
    for (int j = 0; j < kParts; ++j) {
      std::vector<float> part;
      for (int r = i * image.rows() / kParts; r < (i + 1) * image.rows() / kParts; ++r) {
        for (int c = j * image.cols() / kParts; c < (j + 1) * image.cols() / kParts; ++c) {
          if (std::isfinite(image(r, c))) part.push_back(image(r, c));
        }
      }
      if (!part.empty()) levels.push_back(static_cast<float>(quantile(std::move(part), 0.5)));
    }
  }
  return levels;
}

/// Returns how many spots of a grid the frame shows that stand out of the noise of one frame.
int count_spots(const Image<float>& mean_adu, const DarkFrame& dark) {
  constexpr double kStandOut = 2.0;  // standard deviations
  try {
    const FoundGrid found = find_lenslet_grid(mean_adu, {}, false);
    std::vector<float> heights;
    for (std::size_t k = 0; k < found.lit.size(); ++k) {
      if (found.lit[k] == 0) continue;
      const int row = static_cast<int>(std::lround(found.spot_y_px[k]));
      const int col = static_cast<int>(std::lround(found.spot_x_px[k]));
      if (mean_adu.contains(row, col)) heights.push_back(mean_adu(row, col));
    }
    const double typical = quantile(std::move(heights), 0.5) - dark.level_adu;
    return typical > kStandOut * dark.noise_adu ? found.n_lit : 0;
  } catch (const Failure&) {
    return 0;  // A dark has no grid.
  }
}

}  // namespace

DarkFrame measure_dark(const Image<float>& mean_adu, const Image<float>& variance_adu2,
                       int frames) {
  DarkFrame dark;
  dark.level_adu = quantile(finite_values(mean_adu), 0.5);
  if (!variance_adu2.empty()) {
    dark.noise_adu =
        std::sqrt(quantile(finite_values(variance_adu2), 0.5) * mean_of_median_variance(frames));
    return dark;
  }
  std::vector<float> differences;
  for (int r = 0; r < mean_adu.rows(); ++r) {
    for (int c = 0; c + 1 < mean_adu.cols(); ++c) {
      const float difference = std::abs(mean_adu(r, c + 1) - mean_adu(r, c));
      if (std::isfinite(difference)) differences.push_back(difference);
    }
  }
  constexpr double kSigmaOfMedian = 1.4826;  // of |N(0, 1)|
  dark.noise_adu = kSigmaOfMedian * quantile(std::move(differences), 0.5) / std::numbers::sqrt2;
  return dark;
}

std::string find_light_in_dark(const Image<float>& mean_adu, const DarkFrame& dark) {
  constexpr int kLeastSpots = 9;
  constexpr double kUneven = 20.0;  // standard deviations
  const int spots = count_spots(mean_adu, dark);
  if (spots >= kLeastSpots) return say("it shows a grid of ", spots, " spots");
  const std::vector<float> levels = levels_of_parts(mean_adu);
  const double low = quantile(levels, 0.1);
  const double high = quantile(levels, 0.9);
  if (dark.noise_adu > 0.0 && high - low > kUneven * dark.noise_adu) {
    return say("its level varies from ", low, " to ", high, " ADU with a noise of ", dark.noise_adu,
               " ADU");
  }
  return {};
}

}  // namespace curlew
