// ResultsFile: what replay found, in FITS (see docs/files.md).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "service/results/memory_table.h"
#include "service/results/mode_results.h"
#include "service/results/row_table.h"
#include "service/results/track_summary.h"
#include "service/stages.h"

namespace curlew {

/// Which images are written. Each has one plane a frame.
struct SaveOptions {
  bool slopes = false;
  bool flux = false;
  bool phase = false;
  bool whole_phase = false;  ///< only for plans with a hidden phase
  bool solenoidal = false;
  bool circulation = false;
  bool frame = false;    ///< the frames themselves
  bool zernike = false;  ///< the coefficients, and the tables that go with them
};

/// Makes the options from some of the words slopes, flux, phase, whole_phase, solenoidal,
/// circulation, zernike and frame. Throws UsageError, which names an unknown word.
SaveOptions save_options_from(const std::vector<std::string>& words);

/// Says whether the file is one of results or a shard of them, by the key CONTENT. Where vortices
/// are tracked, a shard has the tracker's candidates instead of the vortices.
enum class ResultsContent { kResults, kShard };
inline constexpr const char* kResultsContent = "CURLEW RESULTS";
inline constexpr const char* kShardContent = "CURLEW SHARD";

/// Writes the images frame by frame, and the tables, most of which wait in a file without a name,
/// at commit(). Without commit() no file appears under the name. Throws Failure, which names the
/// file.
class ResultsFile {
 public:
  /// frames: how many frames are expected. More or fewer may come.
  ResultsFile(const std::string& path, const Plan& plan, const SaveOptions& save,
              std::int64_t frames, ResultsContent content = ResultsContent::kResults);

  void add(const FrameSlot& slot);
  /// Adds the frame's latency, once it is complete and add() was called.
  void add_latency(const FrameSlot& slot);
  /// Keeps one more table for commit(). Its name is none of the tables that are written anyway.
  void append(MemoryTable table) { more_tables_.push_back(std::move(table)); }
  void commit();

 private:
  struct Cube {
    int hdu = 0;
    std::int64_t plane_elements = 0;
    std::int64_t planes = 0;  ///< planes that the file has room for
    std::vector<float> (*plane)(const FrameSlot&) = nullptr;
  };

  std::string path_;
  FitsFile file_;
  LensletGrid grid_;
  bool has_candidates_;  ///< instead of vortices
  std::int64_t frames_ = 0;
  std::int64_t observed_ns_ = 0;  ///< UTC of the first frame; 0 where it is not known
  std::vector<Cube> cubes_;
  RowTable frame_table_;
  RowTable vortex_table_;
  RowTable hole_table_;
  RowTable latency_table_;
  TrackSummary tracks_;
  std::vector<MemoryTable> more_tables_;
  std::unique_ptr<ModeResults> modes_;  ///< null if they are not saved
};

}  // namespace curlew
