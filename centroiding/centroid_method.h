// CentroidMethod: the ways from a window's pixels to its spot's position.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace curlew {

enum class CentroidMethod {
  kThresholded,        ///< centre of gravity of what exceeds a threshold, less the threshold
  kPlain,              ///< of what exceeds the background
  kWeighted,           ///< of all light, under a Gaussian that follows the spot
  kCorrelation,        ///< peak of the correlation with a Gaussian, by parabola
  kBrightestPixels,    ///< centre of gravity of the brightest pixels, less the brightest other one
  kMaximumLikelihood,  ///< fit of a Gaussian of known width and a background
};

/// Their names in configurations, files and on the command line, in this order.
inline constexpr std::array<std::string_view, 6> kCentroidMethodNames = {
    "thresholded", "plain", "weighted", "correlation", "brightest_pixels", "maximum_likelihood"};

constexpr std::string_view name_of(CentroidMethod method) {
  return kCentroidMethodNames[static_cast<std::size_t>(method)];
}

/// Whether threshold and centre of gravity are all there is to it (centroid.cpp).
constexpr bool is_centre_of_gravity(CentroidMethod method) {
  return method == CentroidMethod::kThresholded || method == CentroidMethod::kPlain;
}

}  // namespace curlew
