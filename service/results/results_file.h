// ResultsFile: what replay found, in FITS.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "service/results/memory_table.h"
#include "service/stages.h"

namespace curlew {

/// Which images to write, one plane a frame.
struct SaveOptions {
  bool slopes = false;
  bool flux = false;
  bool phase = false;
  bool whole_phase = false;  ///< of plans with a hidden phase
  bool solenoidal = false;
  bool circulation = false;
};

/// "slopes,flux,phase,whole_phase,solenoidal,circulation" or some of these; UsageError names an
/// unknown word.
SaveOptions save_options_from(const std::vector<std::string>& words);

/// Writes images frame by frame and the tables, kept in memory until then, at commit(). Nothing
/// is left under the name without it. Failure names the file.
class ResultsFile {
 public:
  /// frames: how many are expected; more or fewer may come.
  ResultsFile(const std::string& path, const Plan& plan, const SaveOptions& save,
              std::int64_t frames, const std::string& configuration_hash);

  void add(const FrameSlot& slot);
  /// Once the frame's latency is complete, after add().
  void add_latency(const FrameSlot& slot);
  void commit();

 private:
  struct Cube {
    int hdu = 0;
    std::int64_t plane_elements = 0;
    std::int64_t planes = 0;  ///< that the file has room for
    std::vector<float> (*plane)(const FrameSlot&) = nullptr;
  };

  FitsFile file_;
  LensletGrid grid_;
  std::int64_t frames_ = 0;
  std::vector<Cube> cubes_;
  MemoryTable frame_table_;
  MemoryTable vortex_table_;
  MemoryTable hole_table_;
  MemoryTable latency_table_;
};

}  // namespace curlew
