#include "service/daemon/beam_watch.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace curlew {

bool BeamSample::copy(const FrameSlot& slot) noexcept {
  const Centroids& centroids = slot.centroids;
  rows_ = centroids.state.rows();
  cols_ = centroids.state.cols();
  if (state.rows() != rows_ || state.cols() != cols_) return false;
  std::copy(centroids.flux_adu.begin(), centroids.flux_adu.end(), flux_adu.begin());
  std::copy(centroids.state.begin(), centroids.state.end(), state.begin());
  return true;
}

void BeamSample::fit() {
  flux_adu = Image<float>(rows_, cols_);
  state = Image<LensletState>(rows_, cols_);
}

void BeamWatch::look() {
  const BeamSample* sample = tap_.answer();
  if (sample == nullptr) return;
  const Image<LensletState>& state = sample->state;
  if (lit_.rows() != state.rows() || lit_.cols() != state.cols()) {
    light_ = Image<float>(state.rows(), state.cols());
    lit_ = Image<std::uint8_t>(state.rows(), state.cols());
    frames_ = 0;
  }
  if (frames_++ == 0) {
    light_.fill(0.0F);
    lit_.fill(0);
  }
  for (std::size_t k = 0; k < state.size(); ++k) {
    if (state[k] == LensletState::kUnlit) continue;
    lit_[k] = 1;
    if (state[k] != LensletState::kFaint) light_[k] += sample->flux_adu[k];
  }
  tap_.ask();
}

std::optional<BeamReport> BeamWatch::second_over(const BeamReference& reference) {
  const int frames = std::exchange(frames_, 0);
  if (frames == 0) return {};
  for (float& light : light_) light /= static_cast<float>(frames);
  BeamReport report{.figures = measure_beam(light_, lit_), .pitch_m = reference.pitch_m};
  report.warning = judge(report.figures, reference);
  return report;
}

/// Returns the warning, or nothing.
std::string BeamWatch::judge(const BeamFigures& beam, const BeamReference& reference) {
  constexpr int kSureSeconds = 3;
  if (!beam.is_lit())
    return edges_.empty() ? "" : "the beam has left the lenslets over the " + edges_ + " edge";
  std::string edges = edges_that_cut(beam, reference.figures);
  otherwise_ = edges.empty() == edges_.empty() ? 0 : otherwise_ + 1;
  if (otherwise_ >= kSureSeconds || (!edges.empty() && !edges_.empty())) {
    edges_ = std::move(edges);
    otherwise_ = 0;
  }
  return edges_.empty() ? "" : "the beam is cut at the " + edges_ + " edge of the lenslets";
}

}  // namespace curlew
