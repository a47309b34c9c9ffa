// Sweep: several configurations work on the frames of one replay, which are read once.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "centroiding/window_follower.h"
#include "core/frame.h"
#include "detect/tracking/vortex_tracker.h"
#include "service/config.h"
#include "service/results/results_file.h"
#include "service/stages.h"

namespace curlew {

/// Returns the results file of one configuration: that of the replay with the configuration's name
/// before its extension, as night.strict.fits.
std::string sweep_output(const std::string& out, const std::string& name);

/// Works on frames by all configurations but the first, by which the pipeline does it. Where two
/// configurations agree in [centroid] the later one takes the centroids, slopes and circulation of
/// the earlier one, where they agree in [split] as well the phase, and where they differ in nothing
/// but the rate of false alarms the filtered circulation. The results are those of a replay of its
/// own, bit for bit. One thread uses it.
class Sweep {
 public:
  /// `first` is the plan of the first configuration. Throws as Plan and ResultsFile do, and names
  /// the configuration. frames: how many are expected.
  Sweep(const std::vector<NamedConfig>& configs, const Plan& first, const Sensor& sensor,
        const FrameFormat& format, const SaveOptions& save, const std::string& out,
        std::int64_t frames);

  /// Works on the frame by the other configurations. The slot is the pipeline's, as it is when the
  /// frame is finished, and is left so. Throws Failure if a file cannot be written.
  void work(FrameSlot& first);

  /// Lets the files appear under their names.
  void commit();

  /// Returns a table with a line a configuration.
  std::string text() const;

  /// Returns the name of the first configuration that measured nothing in any frame, or nothing.
  std::string without_measurement() const;

 private:
  /// What one configuration found.
  struct Count {
    std::string name;
    std::string path;
    std::int64_t frames = 0;
    std::int64_t vortices = 0;
    std::int64_t measured = 0;  ///< valid lenslets, over all frames

    void add(const FrameSlot& slot);
  };
  struct Run {
    Count count;
    std::unique_ptr<const Plan> plan;
    std::unique_ptr<WindowFollower> follower;  ///< null if the windows stay
    std::unique_ptr<VortexTracker> tracker;    ///< null if nothing is tracked
    std::unique_ptr<FrameSlot> slot;
    std::unique_ptr<ResultsFile> file;
    // The first run that makes the same of a frame; 0 is the pipeline's.
    std::optional<std::size_t> centroids_of;  ///< has the same [centroid]
    std::optional<std::size_t> filter_of;     ///< and filters circulation in the same way
    std::optional<std::size_t> split_of;      ///< has the same [centroid] and [split]
  };

  static Run make_run(const NamedConfig& config, const Sensor& sensor, const FrameFormat& format);
  FrameSlot& slot_of(std::size_t run, FrameSlot& first) const;
  /// Lends the run what others have made of the frame, or gives it back.
  void exchange_shared(Run& run, FrameSlot& first) const noexcept;
  static void run_stages(Run& run, bool saturated_before);

  Count first_;
  std::vector<Run> runs_;  ///< run i + 1 of the sweep
};

}  // namespace curlew
