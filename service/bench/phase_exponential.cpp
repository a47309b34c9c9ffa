#include "service/bench/phase_exponential.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>

namespace curlew {
namespace {

using Phasor = std::complex<float>;

/// A pair of neighbouring lenslets: u_b should be u_a·turn.
struct Link {
  std::size_t a;
  std::size_t b;
  float weight;
  float slope;  ///< Δ, rad
  Phasor turn;
};

std::vector<Link> make_links(const SlopeField& slopes, const Image<float>& flux) {
  float mean = 0.0F;
  for (const float f : flux) mean += std::max(f, 0.0F) / static_cast<float>(flux.size());
  const auto light = [&](std::size_t k) { return std::max(flux[k], 0.0F) + 1e-3F * mean + 1e-30F; };
  std::vector<Link> links;
  const auto add = [&](std::size_t a, std::size_t b, const Image<float>& slope) {
    const float difference = 0.5F * (slope[a] + slope[b]);
    links.push_back(
        {a, b, std::sqrt(light(a) * light(b)), difference, std::polar(1.0F, difference)});
  };
  const auto cols = static_cast<std::size_t>(slopes.cols());
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    if ((k + 1) % cols != 0) add(k, k + 1, slopes.x);
    if (k + cols < slopes.x.size()) add(k, k + cols, slopes.y);
  }
  return links;
}

}  // namespace

std::vector<PointVortex> vortices_of_exponential(const SlopeField& slopes,
                                                 const Image<float>& flux_adu, int iterations) {
  const std::vector<Link> links = make_links(slopes, flux_adu);
  const std::size_t n = slopes.x.size();
  std::vector<float> degree(n, 0.0F);
  for (const Link& link : links) {
    degree[link.a] += link.weight;
    degree[link.b] += link.weight;
  }
  std::vector<Phasor> u(n);
  std::vector<Phasor> sum(n);
  for (std::size_t k = 0; k < n; ++k)  // any start that favours nothing will do
    u[k] = std::polar(1.0F, 2.399963F * static_cast<float>(k));
  const auto gather = [&] {
    std::fill(sum.begin(), sum.end(), Phasor());
    for (const Link& link : links) {
      sum[link.b] += link.weight * link.turn * u[link.a];
      sum[link.a] += link.weight * std::conj(link.turn) * u[link.b];
    }
  };
  for (int step = 0; step < iterations; ++step) {
    gather();
    float norm = 0.0F;
    for (std::size_t k = 0; k < n; ++k) {
      u[k] = 0.5F * (u[k] + sum[k] / degree[k]);
      norm += std::norm(u[k]);
    }
    for (Phasor& value : u) value *= std::sqrt(static_cast<float>(n) / norm);
  }
  for (int sweep = 0; sweep < iterations / 10; ++sweep) {
    for (Phasor& value : u) value /= std::max(std::abs(value), 1e-30F);
    gather();
    for (std::size_t k = 0; k < n; ++k) u[k] += sum[k] / degree[k];
  }

  Image<float> right(slopes.rows(), slopes.cols());
  Image<float> down(slopes.rows(), slopes.cols());
  for (const Link& link : links) {
    const float rest = std::arg(u[link.b] * std::conj(u[link.a] * link.turn));
    (link.b == link.a + 1 ? right : down)[link.a] = link.slope + rest;
  }
  std::vector<PointVortex> vortices;
  for (int r = 0; r + 1 < slopes.rows(); ++r) {
    for (int c = 0; c + 1 < slopes.cols(); ++c) {
      const float loop = right(r, c) + down(r, c + 1) - right(r + 1, c) - down(r, c);
      const long turns = std::lround(loop / 6.28318531F);
      if (turns != 0)
        vortices.push_back(
            {static_cast<float>(c) + 0.5F, static_cast<float>(r) + 0.5F, turns > 0 ? 1.0F : -1.0F});
    }
  }
  return vortices;
}

}  // namespace curlew
