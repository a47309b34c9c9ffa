#include "centroiding/calibration/spot_picture.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "centroiding/calibration/sentence.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Calls visit(value) for the neighbours of a pixel that are on the frame.
template <typename Visit>
void for_each_neighbour(const Image<float>& image, int row, int col, Visit visit) {
  for (int dr = -1; dr <= 1; ++dr) {
    for (int dc = -1; dc <= 1; ++dc) {
      if ((dr != 0 || dc != 0) && image.contains(row + dr, col + dc)) {
        visit(image(row + dr, col + dc));
      }
    }
  }
}

/// Replaces hot pixels by their surroundings. A pixel that towers over all its neighbours is no
/// spot: even a spot whose light is spread over σ = 0.5 px puts a tenth of its peak next to it.
/// They are marked in `hot` where they stand out by at least `matters_adu`.
void remove_hot_pixels(Image<float>& image, double noise_adu, double matters_adu,
                       Image<std::uint8_t>& hot) {
  constexpr float kNoises = 8.0F;
  constexpr float kMinSpread = 0.08F;
  const Image<float> before = image;
  for (int r = 0; r < image.rows(); ++r) {
    for (int c = 0; c < image.cols(); ++c) {
      float sum = 0.0F;
      float largest = -std::numeric_limits<float>::max();
      float second = largest;  // A hot pixel may have one hot neighbour.
      float n = 0.0F;
      for_each_neighbour(before, r, c, [&](float v) {
        sum += v;
        n += 1.0F;
        second = std::max(second, std::min(largest, v));
        largest = std::max(largest, v);
      });
      const float around = (sum - largest) / (n - 1.0F);
      const float excess = before(r, c) - around;
      const float minimum = kNoises * static_cast<float>(noise_adu);
      if (excess > minimum && second - around < std::max(kMinSpread * excess, 0.2F * minimum)) {
        image(r, c) = around;
        hot(r, c) = static_cast<double>(excess) > matters_adu ? 1 : 0;
      }
    }
  }
}

/// Estimates the noise of one pixel from mixed second differences (J. Immerkær, Comput. Vis. Image
/// Underst. 64, 300, 1996), which hardly see what is smooth or streaked along rows or columns. It
/// takes the lower tenth of their sizes, which the spots hardly touch. Where background fills only
/// a part f of the frame, the result is up to 1/f too large.
double estimate_noise(const Image<float>& image) {
  std::vector<float> differences;
  differences.reserve(image.size());
  for (int r = 1; r + 1 < image.rows(); ++r) {
    for (int c = 1; c + 1 < image.cols(); ++c) {
      const auto along_column = [&](int col) {
        return image(r - 1, col) - 2.0F * image(r, col) + image(r + 1, col);
      };
      differences.push_back(
          std::abs(along_column(c - 1) - 2.0F * along_column(c) + along_column(c + 1)));
    }
  }
  constexpr double kLowerTenthOfNormal = 0.12566;  // of |N(0, 1)|
  constexpr double kNorm = 6.0;
  return quantile(std::move(differences), 0.1) / (kLowerTenthOfNormal * kNorm);
}

/// Says which values of a frame's middle are usual, and how far a border's must lie outside.
struct UsualValues {
  double low = 0.0;
  double high = 0.0;
  double margin = 0.0;

  bool excludes(std::vector<float> line) const {
    if (line.empty()) return false;
    const double median = quantile(std::move(line), 0.5);
    return median < low - margin || median > high + margin;
  }
};

bool is_usable(const Image<float>& image, const Image<std::uint8_t>& bad, int row, int col) {
  return std::isfinite(image(row, col)) && (bad.empty() || bad(row, col) == 0);
}

UsualValues usual_values(const Image<float>& image, const Image<std::uint8_t>& bad) {
  std::vector<float> middle;
  for (int r = image.rows() / 4; r < image.rows() - image.rows() / 4; ++r) {
    for (int c = image.cols() / 4; c < image.cols() - image.cols() / 4; ++c) {
      if (is_usable(image, bad, r, c)) middle.push_back(image(r, c));
    }
  }
  UsualValues usual;
  usual.low = quantile(middle, 0.002);
  usual.high = quantile(std::move(middle), 0.998);
  usual.margin = usual.high - usual.low;
  return usual;
}

/// Returns how many columns (or rows) from `first` on, in steps of `step`, hold no picture.
int count_border(const Image<float>& image, const Image<std::uint8_t>& bad, bool columns, int first,
                 int step, const UsualValues& usual) {
  const int most = (columns ? image.cols() : image.rows()) / 4;
  const int length = columns ? image.rows() : image.cols();
  int n = 0;
  for (; n < most; ++n) {
    std::vector<float> line;
    for (int i = 0; i < length; ++i) {
      const int row = columns ? i : first + n * step;
      const int col = columns ? first + n * step : i;
      if (is_usable(image, bad, row, col)) line.push_back(image(row, col));
    }
    if (!usual.excludes(std::move(line))) break;
  }
  return n;
}

}  // namespace

Image<std::uint8_t> find_borders(const Image<float>& reference_adu,
                                 const Image<std::uint8_t>& bad_pixel) {
  const int rows = reference_adu.rows();
  const int cols = reference_adu.cols();
  const UsualValues usual = usual_values(reference_adu, bad_pixel);
  const auto count = [&](bool columns, int first, int step) {
    return count_border(reference_adu, bad_pixel, columns, first, step, usual);
  };
  const int left = count(true, 0, 1);
  const int right = count(true, cols - 1, -1);
  const int top = count(false, 0, 1);
  const int bottom = count(false, rows - 1, -1);
  if (left + right + top + bottom == 0) return {};
  Image<std::uint8_t> border(rows, cols, 0);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      const bool inside = c >= left && c < cols - right && r >= top && r < rows - bottom;
      border(r, c) = inside ? 0 : 1;
    }
  }
  return border;
}

void fill_bad_pixels(Image<float>& image, const Image<std::uint8_t>& bad_pixel, float background) {
  for (std::size_t i = 0; i < image.size(); ++i) {
    if (!std::isfinite(image[i]) || (!bad_pixel.empty() && bad_pixel[i] != 0)) image[i] = kNaN;
  }
  constexpr int kPasses = 8;
  for (int pass = 0; pass < kPasses; ++pass) {
    const Image<float> before = image;
    bool any_left = false;
    for (int r = 0; r < image.rows(); ++r) {
      for (int c = 0; c < image.cols(); ++c) {
        if (!std::isnan(before(r, c))) continue;
        float sum = 0.0F;
        int n = 0;
        for_each_neighbour(before, r, c, [&](float v) {
          if (std::isnan(v)) return;
          sum += v;
          ++n;
        });
        if (n > 0) image(r, c) = sum / static_cast<float>(n);
        any_left = any_left || n == 0;
      }
    }
    if (!any_left) return;
  }
  std::replace_if(
      image.begin(), image.end(), [](float v) { return std::isnan(v); }, background);
}

double quantile(std::vector<float> values, double fraction) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::ptrdiff_t>(fraction * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return static_cast<double>(values[static_cast<std::size_t>(at)]);
}

SpotPicture clean_spot_picture(const Image<float>& reference_adu,
                               const Image<std::uint8_t>& bad_pixel) {
  SpotPicture picture;
  picture.pixels_adu = reference_adu;
  Image<float>& image = picture.pixels_adu;
  picture.border = find_borders(reference_adu, bad_pixel);
  for (std::size_t i = 0; i < picture.border.size(); ++i) {
    if (picture.border[i] != 0) image[i] = kNaN;
  }
  std::vector<float> good;
  good.reserve(image.size());
  for (std::size_t i = 0; i < image.size(); ++i) {
    const bool bad = !std::isfinite(image[i]) || (!bad_pixel.empty() && bad_pixel[i] != 0);
    if (!bad) good.push_back(image[i]);
  }
  if (2 * good.size() < image.size() || good.empty()) {
    throw Failure(say("the reference frame has only ", good.size(), " usable pixels of ",
                      image.size(), ": check its NaN and bad pixels"));
  }
  const auto [low, high] = std::minmax_element(good.begin(), good.end());
  const float top = *high;
  if (*low == top) {
    throw Failure(say("no light: every pixel of the reference frame holds ", top,
                      " ADU, so it is blank or saturated; check shutter, light and exposure"));
  }
  const auto n_top = std::count(good.begin(), good.end(), top);
  if (2 * static_cast<std::size_t>(n_top) > good.size()) {
    throw Failure(say("the reference frame is saturated: ", n_top, " of ", good.size(),
                      " pixels hold ", top, " ADU; expose it less"));
  }
  picture.background_adu = quantile(good, 0.25);
  // A border is filled only once hot pixels beside it are gone, which would spread into it.
  const auto background = static_cast<float>(picture.background_adu);
  for (std::size_t i = 0; i < picture.border.size(); ++i) {
    if (picture.border[i] != 0) image[i] = background;
  }
  fill_bad_pixels(image, bad_pixel, background);
  picture.noise_adu = estimate_noise(image);
  picture.hot = Image<std::uint8_t>(image.rows(), image.cols(), 0);
  constexpr double kMatters = 0.05;  // of the brightest light
  picture.matters_adu = kMatters * (quantile(good, 0.999) - picture.background_adu);
  remove_hot_pixels(image, picture.noise_adu, picture.matters_adu, picture.hot);
  fill_bad_pixels(image, picture.border, background);
  return picture;
}

Image<float> smooth_gaussian(const Image<float>& in, double sigma_px) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma_px));
  std::vector<float> kernel(static_cast<std::size_t>(2 * reach + 1));
  float* const weight = kernel.data() + reach;  // from weight[-reach] to weight[reach]
  for (int i = -reach; i <= reach; ++i) {
    weight[i] = static_cast<float>(std::exp(-0.5 * (i / sigma_px) * (i / sigma_px)));
  }
  Image<float> along_rows(in.rows(), in.cols());
  for (int r = 0; r < in.rows(); ++r) {
    for (int c = 0; c < in.cols(); ++c) {
      float sum = 0.0F;
      float norm = 0.0F;
      for (int i = std::max(-reach, -c); i <= std::min(reach, in.cols() - 1 - c); ++i) {
        sum += weight[i] * in(r, c + i);
        norm += weight[i];
      }
      along_rows(r, c) = sum / norm;
    }
  }
  Image<float> out(in.rows(), in.cols());
  for (int r = 0; r < in.rows(); ++r) {
    const int first = std::max(-reach, -r);
    const int last = std::min(reach, in.rows() - 1 - r);
    float norm = 0.0F;
    for (int i = first; i <= last; ++i) norm += weight[i];
    for (int i = first; i <= last; ++i) {
      const float w = weight[i] / norm;
      for (int c = 0; c < in.cols(); ++c) out(r, c) += w * along_rows(r + i, c);
    }
  }
  return out;
}

}  // namespace curlew
