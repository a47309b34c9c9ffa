#include "service/bench/detection_rows.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <sstream>
#include <utility>

#include "detect/circulation.h"
#include "detect/circulation_finder.h"
#include "detect/classifier/vortex_classifier.h"
#include "detect/false_alarm_control.h"
#include "detect/whitened/whitened_finder.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

double value_at(const Image<float>& map, int row, int col) {
  return map.contains(row, col) ? static_cast<double>(map(row, col)) : 0.0;
}

/// Sums the map round each (r, c), from (r − before, c − before) to (r + after, c + after). Beyond
/// its edge the map counts as 0.
Image<float> window_sums(const Image<float>& map, int rows, int cols, int before, int after) {
  Image<float> sums(rows, cols);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      double sum = 0.0;
      for (int i = r - before; i <= r + after; ++i)
        for (int j = c - before; j <= c + after; ++j) sum += value_at(map, i, j);
      sums(r, c) = static_cast<float>(sum);
    }
  }
  return sums;
}

/// Calls use(row, col) where no neighbour of the same sign is larger in magnitude.
template <typename Use>
void for_each_peak(const Image<float>& map, Use use) {
  for (int r = 0; r < map.rows(); ++r) {
    for (int c = 0; c < map.cols(); ++c) {
      const double sign = map(r, c) > 0.0F ? 1.0 : -1.0;
      const double value = sign * value_at(map, r, c);
      bool peak = value > 0.0;
      for (int i = r - 1; i <= r + 1; ++i)
        for (int j = c - 1; j <= c + 1; ++j) peak = peak && sign * value_at(map, i, j) <= value;
      if (peak) use(r, c);
    }
  }
}

/// Returns the peaks of a signed map whose element (0, 0) lies at (first, first).
std::vector<Candidate> peaks(const Image<float>& map, double first) {
  std::vector<Candidate> found;
  for_each_peak(map, [&](int r, int c) {
    found.push_back({c + first, r + first, map(r, c) > 0.0F ? 1 : -1,
                     std::abs(static_cast<double>(map(r, c)))});
  });
  return found;
}

std::vector<Candidate> peaks_of_circulation(const MeasuredFrame& frame) {
  return peaks(frame.circulation.value, 0.5);
}

std::vector<Candidate> peaks_with_centroid(const MeasuredFrame& frame) {
  const Image<float>& map = frame.circulation.value;
  std::vector<Candidate> found;
  for_each_peak(map, [&](int r, int c) {
    const double sign = map(r, c) > 0.0F ? 1.0 : -1.0;
    double sum = 0.0, sum_x = 0.0, sum_y = 0.0;
    for (int i = r - 1; i <= r + 1; ++i) {
      for (int j = c - 1; j <= c + 1; ++j) {
        const double weight = std::max(0.0, sign * value_at(map, i, j));
        sum += weight;
        sum_x += weight * (j - c);
        sum_y += weight * (i - r);
      }
    }
    found.push_back({c + 0.5 + sum_x / sum, r + 0.5 + sum_y / sum, sign > 0.0 ? 1 : -1,
                     sign * value_at(map, r, c)});
  });
  return found;
}

/// Sums D over the four cells round each lenslet. The lenslet's own slopes cancel in the sum.
Image<float> sums_of_four(const MeasuredFrame& frame) {
  return window_sums(frame.circulation.value, frame.slopes.rows(), frame.slopes.cols(), 1, 0);
}

std::vector<Candidate> peaks_of_four(const MeasuredFrame& frame) {
  return peaks(sums_of_four(frame), 0.0);
}

std::vector<Candidate> peaks_of_nine(const MeasuredFrame& frame) {
  const Image<float>& map = frame.circulation.value;
  return peaks(window_sums(map, map.rows(), map.cols(), 1, 1), 0.5);
}

/// Returns the peaks and pits of a potential that has one value a node. A peak has charge +1.
std::vector<Candidate> extrema(const Image<float>& potential) {
  std::vector<Candidate> found;
  for (const int charge : {1, -1}) {
    for (int r = 0; r < potential.rows(); ++r) {
      for (int c = 0; c < potential.cols(); ++c) {
        const double value = charge * value_at(potential, r, c);
        bool extreme = true;
        for (int i = r - 1; i <= r + 1; ++i) {
          for (int j = c - 1; j <= c + 1; ++j) {
            if (!potential.contains(i, j)) continue;
            extreme = extreme && charge * value_at(potential, i, j) <= value;
          }
        }
        if (extreme) found.push_back({c + 0.5, r + 0.5, charge, value});
      }
    }
  }
  return found;
}

/// Uses the potential ψ of the slopes that a least-squares phase leaves over, which hold no
/// gradient.
std::vector<Candidate> extrema_of_potential(const MeasuredFrame& frame) {
  Image<float> potential = frame.split.potential;
  for (float& value : potential) value = -value;
  return extrema(potential);
}

/// Turns all slopes by a quarter and uses their least-squares potential, because round a positive
/// vortex (−s_y, s_x) is the gradient of −ln r. The mean of four takes it from lenslet centres to
/// nodes.
std::vector<Candidate> extrema_of_turned_slopes(const SplitPlan& plan, const MeasuredFrame& frame) {
  SlopeField turned = frame.slopes;
  for (std::size_t k = 0; k < turned.x.size(); ++k) {
    turned.x[k] = -frame.slopes.y[k];
    turned.y[k] = frame.slopes.x[k];
  }
  SplitWorkspace workspace(plan);
  HodgeSplit split(turned.rows(), turned.cols());
  split_slopes(plan, turned, workspace, split);
  return extrema(window_sums(split.phase, turned.rows() - 1, turned.cols() - 1, 0, 1));
}

/// Ranks by the spots' second moments alone. Only the sign comes from the circulation around.
std::vector<Candidate> peaks_of_spread(const MeasuredFrame& frame) {
  const Centroids& spots = frame.centroids;
  Image<float> spread(frame.slopes.rows(), frame.slopes.cols());
  for (std::size_t k = 0; k < spread.size(); ++k) spread[k] = spots.xx_px2[k] + spots.yy_px2[k];
  const Image<float> sums = sums_of_four(frame);
  std::vector<Candidate> found = peaks(spread, 0.0);
  for (Candidate& candidate : found) {
    const double sum = value_at(sums, static_cast<int>(candidate.y), static_cast<int>(candidate.x));
    candidate.charge = sum > 0.0 ? 1 : -1;
  }
  return found;
}

/// Returns the slopes of the lenslets that have light, as the pipeline's split takes them.
SlopeField lit_slopes(const MeasuredFrame& frame) {
  SlopeField slopes(frame.slopes.rows(), frame.slopes.cols());
  leave_out_weak(frame.centroids, frame.slopes, slopes);
  return slopes;
}

/// Runs find_circulation_vortices with a very low threshold, on the lenslets that have light only.
class ShippedDetector {
 public:
  explicit ShippedDetector(const MeasurementPlan& plan)
      : plan_({.false_alarms_per_frame = kPatience}, plan.sensor().valid,
              plan.sensor().valid.size()) {}

  std::vector<Candidate> operator()(const MeasuredFrame& frame) const {
    const SlopeField slopes = lit_slopes(frame);
    CirculationMap map(slopes.rows(), slopes.cols());
    circulate(slopes, map);
    VortexList vortices(plan_.capacity());
    find_circulation_vortices(plan_, map, vortices);
    std::vector<Candidate> found;
    for (const Vortex& vortex : vortices) {
      const auto significance = static_cast<double>(vortex.significance);
      // Without noise every significance is the same, so |D| ranks the candidates.
      const double rank = significance < static_cast<double>(kMaxSignificance)
                              ? significance
                              : significance + std::abs(static_cast<double>(vortex.circulation));
      found.push_back(
          {static_cast<double>(vortex.x), static_cast<double>(vortex.y), vortex.charge, rank});
    }
    return found;
  }

 private:
  static constexpr double kPatience = 30.0;  // false alarms a frame
  CirculationPlan plan_;
};

/// Runs find_whitened_vortices down to a very low probability, on the lenslets that have light
/// only. Close pairs stay two vortices.
class WhitenedDetector {
 public:
  WhitenedDetector(const MeasurementPlan& plan, double false_alarms_per_frame)
      : plan_(std::make_shared<const WhitenedPlan>(
            WhitenedOptions{.false_alarms_per_frame = false_alarms_per_frame,
                            .min_probability = 0.005,
                            .pair_sigmas = 0.0},
            plan.sensor().valid, plan.sensor().valid.size())) {}

  std::vector<Candidate> operator()(const MeasuredFrame& frame) const {
    const SlopeField slopes = lit_slopes(frame);
    CirculationMap map(slopes.rows(), slopes.cols());
    circulate(slopes, map);
    WhitenedWorkspace workspace(*plan_);
    VortexList vortices(plan_->capacity());
    find_whitened_vortices(*plan_, slopes, frame.centroids.flux_adu, map, workspace, vortices);
    return candidates_by_probability(vortices);
  }

 private:
  std::shared_ptr<const WhitenedPlan> plan_;
};

/// Runs find_classified_vortices down to a very low probability. Unresolved pairs are no
/// candidates.
class ClassifierDetector {
 public:
  explicit ClassifierDetector(const MeasurementPlan& plan)
      : plan_(std::make_shared<const ClassifierPlan>(ClassifierOptions{.min_probability = 0.02},
                                                     spot_camera(plan.sensor()), plan.format())),
        buffers_(std::make_shared<Buffers>()) {}

  std::vector<Candidate> operator()(const MeasuredFrame& frame) const {
    std::unique_ptr<OneFrame> buffers = buffers_->take(*plan_);
    find_classified_vortices(*plan_, frame.frame.view(), frame.shift(), frame.centroids,
                             frame.circulation, buffers->workspace, buffers->vortices);
    std::vector<Candidate> found = candidates_by_probability(buffers->vortices);
    buffers_->give_back(std::move(buffers));
    return found;
  }

 private:
  struct OneFrame {
    explicit OneFrame(const ClassifierPlan& plan)
        : workspace(plan), vortices(2 * plan.features().lenslet_count()) {}
    ClassifierWorkspace workspace;
    VortexList vortices;
  };
  /// As many buffers as threads have asked for at once.
  class Buffers {
   public:
    std::unique_ptr<OneFrame> take(const ClassifierPlan& plan) {
      const std::scoped_lock lock(mutex_);
      if (free_.empty()) return std::make_unique<OneFrame>(plan);
      std::unique_ptr<OneFrame> one = std::move(free_.back());
      free_.pop_back();
      return one;
    }
    void give_back(std::unique_ptr<OneFrame> one) {
      const std::scoped_lock lock(mutex_);
      free_.push_back(std::move(one));
    }

   private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<OneFrame>> free_;
  };

  std::shared_ptr<const ClassifierPlan> plan_;
  std::shared_ptr<Buffers> buffers_;
};

/// Keeps a detector's candidates whose nearest node has a D of their sign that is significant at
/// the stated rate.
class ControlledDetector {
 public:
  ControlledDetector(const MeasurementPlan& plan, double false_alarms_per_frame,
                     DetectorRow detector)
      : plan_({.false_alarms_per_frame = false_alarms_per_frame}, plan.sensor().valid, 1),
        detector_(std::move(detector)) {}

  std::vector<Candidate> operator()(const MeasuredFrame& frame) const {
    const SlopeField slopes = lit_slopes(frame);
    CirculationMap map(slopes.rows(), slopes.cols());
    circulate(slopes, map);
    Image<std::int8_t> marks(map.value.rows(), map.value.cols());
    mark_significant(map, plan_.threshold_sigmas(map.n_valid), marks);
    std::vector<Candidate> found = detector_.find(frame);
    std::erase_if(found, [&](const Candidate& candidate) {
      const int row = std::clamp(static_cast<int>(candidate.y), 0, marks.rows() - 1);
      const int col = std::clamp(static_cast<int>(candidate.x), 0, marks.cols() - 1);
      return marks(row, col) != candidate.charge;
    });
    return found;
  }

 private:
  CirculationPlan plan_;
  DetectorRow detector_;
};

constexpr double kUncontrolled = 1e9;  // false alarms a frame, more than noise can make

}  // namespace

std::vector<DetectorRow> make_detector_rows(const MeasurementPlan& plan,
                                            const std::vector<double>& controlled_rates) {
  std::vector<DetectorRow> rows{
      {"d", "|D|, at the node", peaks_of_circulation},
      {"d_centroid", "|D|, at the centroid of 3x3 nodes", peaks_with_centroid},
      {"sum_2x2", "|sum of D round a lenslet|, at its centre", peaks_of_four},
      {"sum_3x3", "|sum of D over 3x3 nodes|, at the node", peaks_of_nine},
      {"potential", "vortex potential of all slopes (LeBigot & Wild 1999)",
       [&split = plan.split()](const MeasuredFrame& frame) {
         return extrema_of_turned_slopes(split, frame);
       }},
      {"potential_discrepancy", "the same of the slope discrepancy (Tyler 2000)",
       extrema_of_potential},
      {"spread", "spot spread, sign by the circulation around (Kalensky 2023)", peaks_of_spread},
      {"shipped", "find_circulation_vortices: |D| over its sigma", ShippedDetector(plan)},
      {"whitened", "find_whitened_vortices: matched filter on D, whitened by flux",
       WhitenedDetector(plan, kUncontrolled)},
      {"classifier", "find_classified_vortices: a trained network on 4x4 spots",
       ClassifierDetector(plan)},
  };
  const DetectorRow classifier = rows.back();
  for (const double rate : controlled_rates) {
    std::ostringstream suffix;
    suffix << '@' << rate;
    rows.push_back({"whitened" + suffix.str(), "whitened, its t past the threshold of that rate",
                    WhitenedDetector(plan, rate)});
    rows.push_back({"classifier" + suffix.str(),
                    "classifier, D over its sigma past the threshold of that rate",
                    ControlledDetector(plan, rate, classifier)});
  }
  return rows;
}

}  // namespace curlew
