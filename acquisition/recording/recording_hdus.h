// These are the HDUs of a recording, as all its writers make them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/provenance.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

enum class Compression { kNone, kRice };

/// Makes the cube of `frames` frames, all zero, with its keys. Throws Failure for counts that are
/// not ADU (scale 1, zero 0).
void create_recording_image(FitsFile& file, const FrameFormat& format, const Optics& optics,
                            const Detector& detector, const Provenance& provenance,
                            std::int64_t frames, Compression compression = Compression::kNone);

/// Throws Failure, which names the recording, unless the frame is of the format's size and type.
void require_format(const std::string& path, const FrameFormat& format, const FrameView& frame);

/// Holds frame headers as the columns of the table FRAMES.
struct FrameColumns {
  std::vector<std::int64_t> sequence;
  std::vector<std::int64_t> camera_ns;
  std::vector<std::int64_t> received_ns;
  std::vector<std::int32_t> status;

  std::size_t size() const { return sequence.size(); }
  void add(const FrameHeader& header);
  void clear();
};

inline constexpr std::int64_t kFrameRowBytes = 28;  ///< bytes of a row of FRAMES

/// Appends the empty table and selects it.
void create_frame_table(FitsFile& file);

/// Writes the rows into the selected table, from row `first_row` on.
void write_frame_rows(FitsFile& file, std::int64_t first_row, const FrameColumns& rows);

}  // namespace curlew
