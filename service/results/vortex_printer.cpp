#include "service/results/vortex_printer.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <vector>

#include "core/as_size.h"

namespace curlew {
namespace {

double square_distance(const Vortex& found, const TruthVortex& truth) {
  const double dx = static_cast<double>(found.x) - truth.x;
  const double dy = static_cast<double>(found.y) - truth.y;
  return dx * dx + dy * dy;
}

}  // namespace

void VortexPrinter::add(const FrameSlot& slot) {
  const std::span<const Vortex> found(slot.vortices.begin(), slot.vortices.end());
  const auto truth = truth_.of_frame(slot.frame_index);
  const TruthMatch match = match_truth(found, truth);
  std::vector<SceneVortex> scene;
  for (const TruthVortex& vortex : truth)
    scene.push_back({.x = vortex.x, .y = vortex.y, .charge = vortex.charge});
  const std::vector<GradedVortex> graded = grade_vortices(scene);
  true_ += static_cast<std::int64_t>(truth.size());
  for (const GradedVortex& vortex : graded) required_ += vortex.required ? 1 : 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const int j = match.truth_of_found[i];
    if (found[i].charge == 0) {
      ++unresolved_;
    } else if (j < 0) {
      ++false_;
    } else if (graded[as_size(j)].required) {
      ++hits_;
      square_error_ += square_distance(found[i], truth[as_size(j)]);
    } else {
      ++excused_;
    }
  }
  if (found.empty() && truth.empty()) return;
  if (shown_++ < show_) print(slot.frame_index, found, truth, graded, match);
}

void VortexPrinter::summarize() const {
  if (shown_ > show_)
    fmt::print("… and {} more frames with vortices (--show, --jsonl or --out for all)\n",
               shown_ - show_);
  if (!truth_.known()) return;
  fmt::print("against the truth: {} of {} found within {} pitch, {} false", hits_, required_,
             kHitRadius, false_);
  if (hits_ > 0)
    fmt::print(", rms distance {:.3f} pitch",
               std::sqrt(square_error_ / static_cast<double>(hits_)));
  fmt::print("\n");
  if (true_ == required_ && unresolved_ == 0) return;
  fmt::print(
      "not counted: {} true vortices in opposite pairs closer than {} pitch; of the vortices "
      "found, "
      "{} that hit one of those and {} unresolved pairs\n",
      true_ - required_, kClosestRequiredPair, excused_, unresolved_);
}

void VortexPrinter::print(std::int64_t frame, std::span<const Vortex> found,
                          std::span<const TruthVortex> truth,
                          const std::vector<GradedVortex>& graded, const TruthMatch& match) const {
  if (shown_ == 1) {
    fmt::print("{:>6} {:>7} {:>8} {:>8} {:>9} {:>8}", "frame", "charge", "x", "y", "D rad",
               "D/sigma");
    if (show_probability_) fmt::print(" {:>6}", "p");
    if (show_track_) fmt::print(" {:>6}", "track");
    if (truth_.known()) fmt::print("   {:>8} {:>8}", "true x", "true y");
    fmt::print("\n");
  }
  std::vector<bool> seen(truth.size(), false);
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Vortex& v = found[i];
    fmt::print("{:>6} {:>7} {:>8.3f} {:>8.3f} {:>+9.3f} {:>8.1f}", frame,
               v.charge == 0 ? "pair" : fmt::format("{:+}", v.charge), v.x, v.y, v.circulation,
               v.significance);
    if (show_probability_) fmt::print(" {:>6.3f}", v.probability);
    if (show_track_) fmt::print(" {:>6}", v.track);
    const int j = match.truth_of_found[i];
    if (j >= 0) {
      seen[as_size(j)] = true;
      fmt::print("   {:>8.3f} {:>8.3f}", truth[as_size(j)].x, truth[as_size(j)].y);
    } else if (truth_.known() && v.charge != 0) {
      fmt::print("   false");
    }
    fmt::print("\n");
  }
  for (std::size_t j = 0; j < truth.size(); ++j)
    if (!seen[j] && graded[j].required)
      fmt::print("{:>6} {:>+7} {:>{}} {:>8.3f} {:>8.3f}\n", frame, truth[j].charge, "missed",
                 46 + (show_probability_ ? 7 : 0) + (show_track_ ? 7 : 0), truth[j].x, truth[j].y);
}

}  // namespace curlew
