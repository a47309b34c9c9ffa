#include "service/vortex_printer.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <vector>

namespace curlew {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

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
  hits_ += match.hits;
  found_ += static_cast<std::int64_t>(found.size());
  true_ += static_cast<std::int64_t>(truth.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    if (match.truth_of_found[i] >= 0)
      square_error_ += square_distance(found[i], truth[index(match.truth_of_found[i])]);
  if (found.empty() && truth.empty()) return;
  if (shown_++ < show_) print(slot.frame_index, found, truth, match);
}

void VortexPrinter::summarize() const {
  if (shown_ > show_)
    fmt::print("… and {} more frames with vortices (--show, --jsonl or --out for all)\n",
               shown_ - show_);
  if (!truth_.known()) return;
  fmt::print("against the truth: {} of {} found within {} pitch, {} false", hits_, true_,
             kHitRadius, found_ - hits_);
  if (hits_ > 0)
    fmt::print(", rms distance {:.3f} pitch",
               std::sqrt(square_error_ / static_cast<double>(hits_)));
  fmt::print("\n");
}

void VortexPrinter::print(std::int64_t frame, std::span<const Vortex> found,
                          std::span<const TruthVortex> truth, const TruthMatch& match) const {
  if (shown_ == 1) {
    fmt::print("{:>6} {:>7} {:>8} {:>8} {:>9} {:>8}", "frame", "charge", "x", "y", "D rad",
               "D/sigma");
    if (truth_.known()) fmt::print("   {:>8} {:>8}", "true x", "true y");
    fmt::print("\n");
  }
  std::vector<bool> seen(truth.size(), false);
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Vortex& v = found[i];
    fmt::print("{:>6} {:>+7} {:>8.3f} {:>8.3f} {:>+9.3f} {:>8.1f}", frame, v.charge, v.x, v.y,
               v.circulation, v.significance);
    const int j = match.truth_of_found[i];
    if (j >= 0) {
      seen[index(j)] = true;
      fmt::print("   {:>8.3f} {:>8.3f}", truth[index(j)].x, truth[index(j)].y);
    } else if (truth_.known()) {
      fmt::print("   false");
    }
    fmt::print("\n");
  }
  for (std::size_t j = 0; j < truth.size(); ++j)
    if (!seen[j])
      fmt::print("{:>6} {:>+7} {:>46} {:>8.3f} {:>8.3f}\n", frame, truth[j].charge, "missed",
                 truth[j].x, truth[j].y);
}

}  // namespace curlew
