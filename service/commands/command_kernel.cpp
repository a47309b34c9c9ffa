#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "core/error.h"
#include "detect/linear_core.h"
#include "detect/vortex_kernel.h"
#include "service/commands/commands.h"
#include "service/program/version.h"

namespace curlew {
namespace {

enum class Weight { kUniform, kIntensity };

struct KernelOptions {
  Morphology morphology;
  Weight weight = Weight::kUniform;
  double extent = 2.0;  // pitches
  double step = 0.05;   // pitches
  bool json = false;
  bool csv = false;
};

/// The circulation D, in rad, of the cell from whose centre the vortex is (μ, ν) away.
using Circulation = std::function<double(double mu, double nu)>;

struct Minimum {
  double mu = 0.0;
  double nu = 0.0;
  double circulation = 0.0;
};

/// The range of a quantity over all positions of the vortex.
struct Range {
  double minimum = 0.0;
  double mean = 0.0;
  double maximum = 0.0;
};

struct KernelSummary {
  double peak = 0.0;
  double slow_axis_deg = 0.0;  // from +μ to +ν, in (−90, 90]
  Minimum minimum;
  Range nearest;  // D of the cell that the vortex is in
  Range two;      // sum over the four cells round the lenslet that the vortex is in
  Range three;    // sum over the cell that the vortex is in and the eight round it
};

constexpr int kMaxPoints = 2001;  // along a side of the map

void check(const KernelOptions& o) {
  if (!std::isfinite(o.morphology.alpha_rad) || !std::isfinite(o.morphology.beta_rad))
    throw UsageError("--alpha and --beta must be finite angles in radians");
  if (!(o.extent > 0.0 && o.extent <= 100.0) || !(o.step > 0.0 && o.step <= o.extent) ||
      2.0 * o.extent / o.step + 1.0 > kMaxPoints)
    throw UsageError(fmt::format(
        "--extent must lie in (0, 100] pitches and --step in (0, extent], with at most {} points "
        "a side",
        kMaxPoints));
}

Circulation circulation_of(const KernelOptions& o) {
  if (o.weight == Weight::kUniform)
    return [kernel = VortexKernel(o.morphology)](double mu, double nu) {
      return kernel.circulation(mu, nu);
    };
  return
      [core = LinearCore(o.morphology)](double mu, double nu) { return core.circulation(mu, nu); };
}

/// Returns the positions from −extent to extent in steps; 0 is among them.
std::vector<double> positions(const KernelOptions& o) {
  const auto half = static_cast<int>(std::floor(o.extent / o.step * (1.0 + 1e-9)));
  std::vector<double> values;
  for (int i = -half; i <= half; ++i) values.push_back(i * o.step);
  return values;
}

/// Finds the least D of the map, and walks downhill from there in ever smaller steps. It uses no
/// derivative, because D has creases.
Minimum find_minimum(const Circulation& d, const std::vector<double>& at, double step) {
  Minimum best{0.0, 0.0, d(0.0, 0.0)};
  const auto attempt = [&](double mu, double nu) {
    const double value = d(mu, nu);
    if (value >= best.circulation) return false;
    best = {mu, nu, value};
    return true;
  };
  for (const double nu : at)
    for (const double mu : at) attempt(mu, nu);
  const double rim = at.back();
  while (step > 1e-9) {
    const Minimum from = best;
    bool lower = false;
    for (const auto& [x, y] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
      lower = attempt(std::clamp(from.mu + x * step, -rim, rim),
                      std::clamp(from.nu + y * step, -rim, rim)) ||
              lower;
    if (!lower) step *= 0.5;
  }
  return best;
}

/// Returns the range of the sum of D over the cells (mu − shift, nu − shift), for all (mu, nu)
/// within half a pitch. The mean is by the midpoint rule.
Range range_over_positions(const Circulation& d, const std::vector<double>& shifts) {
  constexpr int kSteps = 32;
  const auto sum = [&](double mu, double nu) {
    double total = 0.0;
    for (const double y : shifts)
      for (const double x : shifts) total += d(mu - x, nu - y);
    return total;
  };
  Range range{sum(0.0, 0.0), 0.0, sum(0.0, 0.0)};
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const double value =
          sum(static_cast<double>(j) / kSteps - 0.5, static_cast<double>(i) / kSteps - 0.5);
      range.minimum = std::min(range.minimum, value);
      range.maximum = std::max(range.maximum, value);
      if (i < kSteps && j < kSteps)
        range.mean += sum((j + 0.5) / kSteps - 0.5, (i + 0.5) / kSteps - 0.5) / (kSteps * kSteps);
    }
  }
  return range;
}

KernelSummary summarize(const KernelOptions& o, const Circulation& d,
                        const std::vector<double>& at) {
  KernelSummary summary;
  summary.peak = o.weight == Weight::kUniform ? VortexKernel(o.morphology).peak_circulation()
                                              : LinearCore(o.morphology).peak_circulation();
  // |u|² = r²(1 + sin α cos(2θ + β)) is least where 2θ + β = π.
  const double slow = 90.0 - 90.0 * o.morphology.beta_rad / std::numbers::pi +
                      (std::sin(o.morphology.alpha_rad) < 0.0 ? 90.0 : 0.0);
  summary.slow_axis_deg = std::remainder(slow, 180.0);
  summary.minimum = find_minimum(d, at, o.step);
  summary.nearest = range_over_positions(d, {0.0});
  summary.two = range_over_positions(d, {-0.5, 0.5});
  summary.three = range_over_positions(d, {-1.0, 0.0, 1.0});
  return summary;
}

const char* name_of(Weight weight) { return weight == Weight::kUniform ? "uniform" : "intensity"; }

nlohmann::ordered_json range_json(const Range& range) {
  return {{"least", range.minimum}, {"mean", range.mean}, {"most", range.maximum}};
}

void print_json(const KernelOptions& o, const Circulation& d, const std::vector<double>& at) {
  const KernelSummary summary = summarize(o, d, at);
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["alpha_rad"] = o.morphology.alpha_rad;
  json["beta_rad"] = o.morphology.beta_rad;
  json["weight"] = name_of(o.weight);
  json["slow_axis_deg"] = summary.slow_axis_deg;
  json["peak_rad"] = summary.peak;
  json["minimum"] = {{"circulation_rad", summary.minimum.circulation},
                     {"mu", summary.minimum.mu},
                     {"nu", summary.minimum.nu}};
  json["sums_rad"] = {{"nearest", range_json(summary.nearest)},
                      {"2x2", range_json(summary.two)},
                      {"3x3", range_json(summary.three)}};
  json["positions"] = at;
  for (const double nu : at) {
    std::vector<double> row;
    row.reserve(at.size());
    for (const double mu : at) row.push_back(d(mu, nu));
    json["circulation_rad"].push_back(row);
  }
  fmt::print("{}\n", json.dump());
}

void print_csv(const Circulation& d, const std::vector<double>& at) {
  fmt::print("mu_pitch,nu_pitch,circulation_rad\n");
  for (const double nu : at)
    for (const double mu : at) fmt::print("{:.9g},{:.9g},{:.12g}\n", mu, nu, d(mu, nu));
}

void print_text(const KernelOptions& o, const Circulation& d, const std::vector<double>& at) {
  const KernelSummary s = summarize(o, d, at);
  fmt::print("morphology α {:.6g} rad, β {:.6g} rad; slopes averaged by {} weight\n",
             o.morphology.alpha_rad, o.morphology.beta_rad, name_of(o.weight));
  if (std::sin(o.morphology.alpha_rad) != 0.0)
    fmt::print("slow axis {:.4g} deg from +μ (x) towards +ν (y)\n", s.slow_axis_deg);
  fmt::print("vortex on the node: D = {:.6f} rad\n", s.peak);
  fmt::print("least D within {:.4g} pitches: {:.6f} rad at ({:.4f}, {:.4f})\n", at.back(),
             s.minimum.circulation, s.minimum.mu, s.minimum.nu);
  fmt::print("\nover all positions, rad      least     mean     most\n");
  const auto row = [](const char* name, const Range& range) {
    fmt::print("{:24} {:9.4f}{:9.4f}{:9.4f}\n", name, range.minimum, range.mean, range.maximum);
  };
  row("nearest node", s.nearest);
  row("2x2 round the lenslet", s.two);
  row("3x3 round the node", s.three);
}

void print_kernel(const KernelOptions& options) {
  check(options);
  const Circulation d = circulation_of(options);
  const std::vector<double> at = positions(options);
  if (options.csv) {
    print_csv(d, at);
  } else if (options.json) {
    print_json(options, d, at);
  } else {
    print_text(options, d, at);
  }
}

}  // namespace

void add_kernel(CLI::App& app) {
  auto options = std::make_shared<KernelOptions>();
  CLI::App* command = app.add_subcommand(
      "kernel", "The circulation that a vortex of any morphology and position gives");
  command
      ->add_option("--alpha", options->morphology.alpha_rad,
                   "alpha of the morphology, rad; 0 is a round core")
      ->capture_default_str();
  command->add_option("--beta", options->morphology.beta_rad, "beta of the morphology, rad")
      ->capture_default_str();
  command
      ->add_option("--weight", options->weight,
                   "weight of the phase gradient in a lenslet: uniform (default, as the paper) or "
                   "intensity (what centroids see of a core of linear amplitude)")
      ->transform(CLI::CheckedTransformer(std::map<std::string, Weight>{
          {"uniform", Weight::kUniform}, {"intensity", Weight::kIntensity}}));
  command
      ->add_option(
          "--extent", options->extent,
          "greatest distance of the vortex from the cell's centre along each axis, pitches")
      ->capture_default_str();
  command->add_option("--step", options->step, "distance between positions, pitches")
      ->capture_default_str();
  auto* json = command->add_flag("--json", options->json, "print JSON, with the map of D");
  command->add_flag("--csv", options->csv, "print only the map of D, as CSV")->excludes(json);
  command->callback([options] { print_kernel(*options); });
}

}  // namespace curlew
