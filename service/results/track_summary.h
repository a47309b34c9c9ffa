// TrackSummary sums up what each track of a run was like.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/frame.h"
#include "core/vortex.h"
#include "service/results/row_table.h"

namespace curlew {

/// One track, over all frames that show its vortex.
struct TrackLife {
  std::int64_t track = -1;
  int charge = 0;
  std::int64_t first_frame = 0;
  std::int64_t last_frame = 0;
  std::int64_t sightings = 0;  ///< frames that show it; the others in between only predict it
  double life = 0.0;           ///< from the first sighting to the last, s (frames without a clock)
  double x = 0.0;              ///< mean place, lenslet units
  double y = 0.0;
  /// Velocity of the straight line that fits the sightings best, pitches a second (a frame without
  /// a clock), and its standard error from their scatter. NaN for fewer than 2, or 3, sightings.
  double velocity_x = 0.0;
  double velocity_y = 0.0;
  double error_velocity_x = 0.0;
  double error_velocity_y = 0.0;
  double probability = 0.0;  ///< mean
};

class TrackSummary {
 public:
  /// Takes the tracked vortices of the frame; frames come in their order.
  void add(std::int64_t frame, const FrameHeader& header, const VortexList& vortices);

  /// Returns the tracks by their numbers.
  std::vector<TrackLife> tracks() const;

  /// Returns the table TRACKS of a results file. beside: the file beside which rows wait.
  RowTable table(const std::string& beside) const;

  /// Returns a table for people, of the `most` tracks that were seen most often; empty without
  /// tracks.
  std::string text(std::size_t most) const;

 private:
  /// Sums over the sightings, of times and places less those of the first one.
  struct Sums {
    int charge = 0;
    std::int64_t first_frame = 0;
    std::int64_t last_frame = 0;
    double begin = 0.0, x0 = 0.0, y0 = 0.0;
    double n = 0.0, last_t = 0.0, t = 0.0, tt = 0.0, p = 0.0;
    double x = 0.0, xx = 0.0, xt = 0.0;
    double y = 0.0, yy = 0.0, yt = 0.0;
  };

  std::map<std::int64_t, Sums> sums_;
  bool clock_ = false;
};

}  // namespace curlew
