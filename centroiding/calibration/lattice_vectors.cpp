#include "centroiding/calibration/lattice_vectors.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>
#include <unsupported/Eigen/FFT>
#include <vector>

#include "core/error.h"

namespace curlew {
namespace {

using Complex = std::complex<float>;

constexpr double kShortestPitchPx = 3.2;  // shortest of a grid of 4 px seen through noise
constexpr int kLongestLagPx = 256;

struct Peak {
  double x = 0.0;
  double y = 0.0;
  double height = 0.0;
};

int next_fast_size(int n) {
  for (;; ++n) {
    int rest = n;
    for (int p : {2, 3, 5}) {
      while (rest % p == 0) rest /= p;
    }
    if (rest == 1) return n;
  }
}

/// Returns means over boxes of (2·radius+1)² px. At the rim a mean is over what is left of its box.
Image<float> smooth_box(const Image<float>& in, int radius) {
  Image<double> sums(in.rows() + 1, in.cols() + 1);  // sums of all pixels above and to the left
  for (int r = 0; r < in.rows(); ++r) {
    for (int c = 0; c < in.cols(); ++c) {
      sums(r + 1, c + 1) =
          sums(r, c + 1) + sums(r + 1, c) - sums(r, c) + static_cast<double>(in(r, c));
    }
  }
  Image<float> out(in.rows(), in.cols());
  for (int r = 0; r < in.rows(); ++r) {
    const int top = std::max(r - radius, 0);
    const int bottom = std::min(r + radius + 1, in.rows());
    for (int c = 0; c < in.cols(); ++c) {
      const int left = std::max(c - radius, 0);
      const int right = std::min(c + radius + 1, in.cols());
      const double sum =
          sums(bottom, right) - sums(top, right) - sums(bottom, left) + sums(top, left);
      out(r, c) = static_cast<float>(sum / ((bottom - top) * (right - left)));
    }
  }
  return out;
}

/// Returns the brightness on a scale that is linear in the noise and logarithmic far above it. What
/// varies slowly is taken away. None of this filtering moves a period.
Image<float> compress(const SpotPicture& picture) {
  constexpr double kLinearNoises = 10.0;
  // This fraction of the brightest pixels sets the scale where there is no noise.
  constexpr double kLinearFraction = 0.03;
  constexpr double kSmoothPx = 0.7;
  const Image<float>& in = picture.pixels_adu;
  const double top = quantile(std::vector<float>(in.begin(), in.end()), 0.999);
  const double scale = std::max(
      {kLinearNoises * picture.noise_adu, kLinearFraction * (top - picture.background_adu), 1e-30});
  Image<float> out(in.rows(), in.cols());
  for (std::size_t i = 0; i < in.size(); ++i) {
    out[i] = static_cast<float>(
        std::asinh((static_cast<double>(in[i]) - picture.background_adu) / scale));
  }
  out = smooth_gaussian(out, kSmoothPx);
  const Image<float> slow = smooth_box(out, std::min(in.rows(), in.cols()) / 6);
  for (std::size_t i = 0; i < in.size(); ++i) out[i] -= slow[i];
  return out;
}

void transform_rows(Image<Complex>& image, bool forward) {
  Eigen::FFT<float> fft;
  fft.SetFlag(Eigen::FFT<float>::Unscaled);
  std::vector<Complex> row(static_cast<std::size_t>(image.cols()));
  for (int r = 0; r < image.rows(); ++r) {
    Complex* at = image.data() + static_cast<std::size_t>(r) * row.size();
    if (forward) {
      fft.fwd(row.data(), at, image.cols());
    } else {
      fft.inv(row.data(), at, image.cols());
    }
    std::copy(row.begin(), row.end(), at);
  }
}

/// Goes block by block, because a column of a large image is a cache line a pixel.
void transpose(const Image<Complex>& in, Image<Complex>& out) {
  constexpr int kBlock = 16;
  for (int top = 0; top < in.rows(); top += kBlock)
    for (int left = 0; left < in.cols(); left += kBlock)
      for (int c = left; c < std::min(left + kBlock, in.cols()); ++c)
        for (int r = top; r < std::min(top + kBlock, in.rows()); ++r) out(c, r) = in(r, c);
}

/// Returns the autocorrelation for lags up to `reach` px, divided by its value at lag 0. Its rows
/// are y = 0…reach and its columns x = −reach…reach. The other half plane is its mirror image.
Image<float> autocorrelate(const Image<float>& in, int reach) {
  Image<Complex> field(next_fast_size(in.rows() + reach), next_fast_size(in.cols() + reach));
  for (int r = 0; r < in.rows(); ++r) {
    for (int c = 0; c < in.cols(); ++c) field(r, c) = in(r, c);
  }
  Image<Complex> turned(field.cols(), field.rows());
  transform_rows(field, true);
  transpose(field, turned);
  transform_rows(turned, true);
  for (Complex& value : turned) value = std::norm(value);
  transform_rows(turned, false);
  transpose(turned, field);
  transform_rows(field, false);
  const float norm = field(0, 0).real();
  Image<float> lags(reach + 1, 2 * reach + 1);
  for (int y = 0; y <= reach; ++y) {
    for (int x = -reach; x <= reach; ++x) {
      lags(y, x + reach) = field(y, x < 0 ? x + field.cols() : x).real() / norm;
    }
  }
  return lags;
}

/// Lags gives the autocorrelation at any lag within reach, in both half planes.
class Lags {
 public:
  Lags(Image<float> values, int reach) : values_(std::move(values)), reach_(reach) {}
  int reach() const { return reach_; }
  bool contains(int x, int y) const { return std::abs(x) <= reach_ && std::abs(y) <= reach_; }
  float operator()(int x, int y) const {
    return y < 0 ? values_(-y, reach_ - x) : values_(y, reach_ + x);
  }

 private:
  Image<float> values_;
  int reach_;
};

/// Returns how far from the middle point the parabola through three points has its peak.
double vertex(double before, double middle, double after) {
  const double curvature = before - 2.0 * middle + after;
  return curvature < 0.0 ? std::clamp(0.5 * (before - after) / curvature, -0.5, 0.5) : 0.0;
}

/// Returns the highest lag within `radius` of (x, y), refined between pixels. Its height is −1
/// where it is off the map.
Peak highest_near(const Lags& lags, double x, double y, double radius) {
  const int r = static_cast<int>(std::ceil(radius));
  const int cx = static_cast<int>(std::lround(x));
  const int cy = static_cast<int>(std::lround(y));
  Peak best{0.0, 0.0, -1.0};
  if (!lags.contains(cx - r - 1, cy - r - 1) || !lags.contains(cx + r + 1, cy + r + 1)) return best;
  int bx = cx;
  int by = cy;
  for (int iy = cy - r; iy <= cy + r; ++iy) {
    for (int ix = cx - r; ix <= cx + r; ++ix) {
      if (std::hypot(ix - x, iy - y) > radius + 0.5) continue;
      if (static_cast<double>(lags(ix, iy)) > best.height) {
        best.height = static_cast<double>(lags(ix, iy));
        bx = ix;
        by = iy;
      }
    }
  }
  const auto at = [&](int ix, int iy) { return static_cast<double>(lags(ix, iy)); };
  best.x = bx + vertex(at(bx - 1, by), best.height, at(bx + 1, by));
  best.y = by + vertex(at(bx, by - 1), best.height, at(bx, by + 1));
  return best;
}

/// Finds the peaks of the half plane y ≥ 0 that nothing within 0.45 of their own length exceeds.
/// Lattice points pass this test; the slopes and ripples of the central peak do not.
std::vector<Peak> find_peaks(const Lags& lags, double min_height) {
  constexpr double kClear = 0.45;
  std::vector<Peak> peaks;
  const int reach = lags.reach();
  for (int y = 0; y < reach; ++y) {
    for (int x = -reach + 1; x < reach; ++x) {
      const double length = std::hypot(x, y);
      const float here = lags(x, y);
      // Where the picture's values are beyond all measure, the height is no number.
      if (length < kShortestPitchPx || (y == 0 && x < 0) ||
          !(static_cast<double>(here) >= min_height)) {
        continue;
      }
      const double clear = std::max(kClear * length, 1.5);
      const int r = static_cast<int>(clear);
      const auto exceeds = [&](int dx, int dy) {
        return std::hypot(dx, dy) <= clear && lags.contains(x + dx, y + dy) &&
               lags(x + dx, y + dy) > here;
      };
      bool highest = true;
      // The pixels are tested ring by ring, so that slopes are dismissed at once.
      for (int i = 1; highest && i <= r; ++i) {
        for (int k = -i; highest && k <= i; ++k) {
          highest = !exceeds(k, -i) && !exceeds(k, i) && !exceeds(-i, k) && !exceeds(i, k);
        }
      }
      if (highest) {
        const Peak fine = highest_near(lags, x, y, 0.0);
        if (fine.height > 0.0) peaks.push_back(fine);
      }
    }
  }
  return peaks;
}

double cross(const std::array<double, 2>& a, const std::array<double, 2>& b) {
  return a[0] * b[1] - a[1] * b[0];
}
double dot(const std::array<double, 2>& a, const std::array<double, 2>& b) {
  return a[0] * b[0] + a[1] * b[1];
}
double length(const std::array<double, 2>& a) { return std::hypot(a[0], a[1]); }

/// Reduces the lattice after Lagrange and Gauss: a becomes the shortest vector and b the next, with
/// a·b ≥ 0.
void reduce(LatticeVectors& v) {
  for (int i = 0; i < 32; ++i) {
    if (length(v.a) > length(v.b)) std::swap(v.a, v.b);
    const double n = std::round(dot(v.a, v.b) / dot(v.a, v.a));
    if (n == 0.0) break;
    for (std::size_t k = 0; k < 2; ++k) v.b[k] -= n * v.a[k];
  }
  if (dot(v.a, v.b) < 0.0) v.b = {-v.b[0], -v.b[1]};
}

/// Fits a and b to the autocorrelation's peaks at m·a + n·b. Peaks ever farther out are taken in,
/// because at m·a an error of a pixel changes a by only 1/m pixels.
void refine(LatticeVectors& v, const Lags& lags, double min_height) {
  for (int order = 1; order <= 8; ++order) {
    double mm = 0.0;
    double mn = 0.0;
    double nn = 0.0;
    std::array<double, 2> mx{};
    std::array<double, 2> nx{};
    for (int m = -order; m <= order; ++m) {
      for (int n = 0; n <= order; ++n) {
        if (n == 0 && m <= 0) continue;
        const Peak p = highest_near(lags, m * v.a[0] + n * v.b[0], m * v.a[1] + n * v.b[1],
                                    0.25 * length(v.a));
        if (p.height < min_height) continue;
        mm += p.height * m * m;
        mn += p.height * m * n;
        nn += p.height * n * n;
        mx = {mx[0] + p.height * m * p.x, mx[1] + p.height * m * p.y};
        nx = {nx[0] + p.height * n * p.x, nx[1] + p.height * n * p.y};
      }
    }
    const double det = mm * nn - mn * mn;
    if (det <= 1e-9 * mm * nn) return;
    for (std::size_t k = 0; k < 2; ++k) {
      v.a[k] = (nn * mx[k] - mn * nx[k]) / det;
      v.b[k] = (mm * nx[k] - mn * mx[k]) / det;
    }
  }
}

}  // namespace

double LatticeVectors::length_ratio() const { return length(b) / length(a); }

double LatticeVectors::angle_deg() const {
  return std::atan2(std::abs(cross(a, b)), dot(a, b)) * 180.0 / std::numbers::pi;
}

LatticeVectors find_lattice_vectors(const SpotPicture& picture) {
  const Image<float> compressed = compress(picture);
  const int shorter = std::min(compressed.rows(), compressed.cols());
  const int reach = std::min(kLongestLagPx, shorter / 2);
  if (reach < 8) throw Failure("the reference frame is too small to hold a grid of spots");
  const Lags lags(autocorrelate(compressed, reach), reach);

  // Smoothed noise correlates with itself by chance. The standard deviation of that correlation is
  // 1/√(independent pixels).
  constexpr double kSigmas = 8.0;
  constexpr double kPixelsPerIndependent = 6.2;  // 4πσ² of the smoothing
  const double by_chance =
      kSigmas * std::sqrt(kPixelsPerIndependent / static_cast<double>(compressed.size()));
  const double min_height = std::max(0.02, by_chance);
  std::vector<Peak> peaks = find_peaks(lags, min_height);
  if (peaks.empty()) {
    throw Failure(
        "no grid of spots: nothing in the reference frame repeats; check light, focus and that it "
        "is a frame of spots");
  }
  const double highest =
      std::max_element(peaks.begin(), peaks.end(), [](const Peak& p, const Peak& q) {
        return p.height < q.height;
      })->height;
  std::erase_if(peaks, [&](const Peak& p) { return p.height < 0.5 * highest; });
  std::sort(peaks.begin(), peaks.end(), [](const Peak& p, const Peak& q) {
    return std::hypot(p.x, p.y) < std::hypot(q.x, q.y);
  });
  LatticeVectors v;
  v.a = {peaks.front().x, peaks.front().y};
  const auto second = std::find_if(peaks.begin(), peaks.end(), [&](const Peak& p) {
    const std::array<double, 2> b{p.x, p.y};
    return std::abs(cross(v.a, b)) > 0.5 * length(v.a) * length(b);
  });
  if (second == peaks.end()) {
    throw Failure(
        "no grid of spots: the reference frame repeats in one direction only; check that it shows "
        "at least 2×2 spots and no stripes");
  }
  v.b = {second->x, second->y};
  reduce(v);
  refine(v, lags, min_height);
  reduce(v);

  // These limits are wide enough for optics that stretch the grid, and narrow enough to tell 60°
  // from 90°.
  const bool equal = v.length_ratio() < 1.12;
  const double angle = v.angle_deg();
  if (equal && angle > 82.0) v.kind = LatticeKind::kSquare;
  if (equal && angle < 68.0) v.kind = LatticeKind::kHexagonal;
  return v;
}

}  // namespace curlew
