// PublishOptions say what Curlew shows to other programs in shared memory.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace curlew {

/// The streams, in the order in which a frame is written to them: who waits for the slopes finds
/// the mask of the same frame, and the large frame comes last.
enum class PublishedStream : std::uint8_t {
  kMask,         ///< [rows, 2·cols]: 1 where the slope is valid, else 0
  kSlopes,       ///< [rows, 2·cols]: x on the left, y on the right; rad a pitch
  kFlux,         ///< [rows, cols], ADU
  kPhase,        ///< [rows, cols], rad; the least-squares phase
  kWholePhase,   ///< [rows, cols], rad; with what the vortices add
  kCirculation,  ///< [rows − 1, cols − 1], rad
  kVortices,     ///< [capacity, columns] in double; the keyword COUNT says how many rows are used
  kZernike,      ///< [1, modes], rad rms; Noll's modes from 2 on; 0 where they are not known
  kFrame,        ///< [frame rows, frame cols], counts as they came
};

/// Section [publish].
struct PublishOptions {
  std::vector<PublishedStream> streams;  ///< none: nothing is published
  std::string prefix = "curlew_";        ///< the stream of slopes is PREFIXslopes
  std::string folder;                    ///< empty: $MILK_SHM_DIR, /milk/shm or /tmp
};

}  // namespace curlew
