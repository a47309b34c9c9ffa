// CentroidMethod names the ways to find the position of a spot from its window's pixels.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace curlew {

enum class CentroidMethod {
  kThresholded,  ///< centre of gravity of the light above a threshold, less the threshold
  kPlain,        ///< centre of gravity of the light above the background
  kWeighted,     ///< centre of gravity of all light, weighted by a Gaussian that follows the spot
  kCorrelation,  ///< peak of the correlation with a Gaussian, refined by a parabola
  kBrightestPixels,    ///< centre of gravity of the n brightest pixels, less the light of the next
  kMaximumLikelihood,  ///< fit of a Gaussian of known width and of a background
};

/// These are the methods' names in configurations, in files and on the command line, in the order
/// of the enum.
inline constexpr std::array<std::string_view, 6> kCentroidMethodNames = {
    "thresholded", "plain", "weighted", "correlation", "brightest_pixels", "maximum_likelihood"};

constexpr std::string_view name_of(CentroidMethod method) {
  return kCentroidMethodNames[static_cast<std::size_t>(method)];
}

/// Returns whether the method is done after threshold and centre of gravity, both of which
/// centroid.cpp computes.
constexpr bool is_centre_of_gravity(CentroidMethod method) {
  return method == CentroidMethod::kThresholded || method == CentroidMethod::kPlain;
}

}  // namespace curlew
