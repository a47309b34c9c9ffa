// A StreamPublisher shows every frame's results to other programs, in shared memory.
#pragma once

#include <memory>
#include <vector>

#include "reconstruct/modes/mode_fit.h"
#include "service/publish/publish_options.h"
#include "service/publish/stream_writer.h"
#include "service/stages.h"

namespace curlew {

/// Says where the data of a stream go.
struct StreamTarget {
  std::byte* data;
  std::size_t capacity;  ///< rows of kVortices; else 0
  ModeFit* modes;        ///< null where no stream needs it
};

/// Fills in the data of a frame, and returns what the keyword of the count says.
using FillStream = std::int64_t (*)(const FrameSlot& slot, const StreamTarget& to) noexcept;

class StreamPublisher {
 public:
  /// Makes the streams for frames of this format and results of this plan. Throws what StreamWriter
  /// throws, and UsageError for a prefix that cannot stand in a file's name.
  StreamPublisher(const PublishOptions& options, const Plan& plan, const FrameFormat& format);

  /// Writes the slot's results into the streams. It never waits or allocates. A slot whose lenslets
  /// or frame are of another number is left out.
  void publish(const FrameSlot& slot) noexcept;

 private:
  struct Stream {
    FillStream fill;
    std::size_t capacity;  ///< rows of kVortices; else 0
    std::unique_ptr<StreamWriter> writer;
  };

  void make_modes(const Plan& plan);

  LensletGrid grid_;
  FrameFormat format_;
  std::unique_ptr<const ModePlan> mode_plan_;
  std::unique_ptr<ModeFit> modes_;
  std::vector<Stream> streams_;
};

}  // namespace curlew
