// A RecordingWriter writes frames and their headers into a FITS file, and the truth beside them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/recording_hdus.h"
#include "acquisition/recording/truth_vortex.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Writes a recording (docs/files.md): the cube as primary image, 8 bits or 16 with BZERO 32768,
/// then the table FRAMES and, for simulated frames, TRUTH. The file appears under its name by
/// commit() and not before. All errors are Failure naming the file. It keeps 28 bytes per frame in
/// memory.
class RecordingWriter {
 public:
  /// format: counts must be ADU (scale 1, zero 0); others are refused.
  RecordingWriter(const std::string& path, const FrameFormat& format, const Optics& optics,
                  const Detector& detector, const Provenance& provenance);

  /// Makes a writer of a tile-compressed recording without loss (Rice): an empty primary, and the
  /// cube in the first extension. Exactly `frames` frames must be appended. The other arguments are
  /// those of the constructor.
  static RecordingWriter compressed(const std::string& path, const FrameFormat& format,
                                    const Optics& optics, const Detector& detector,
                                    const Provenance& provenance, std::int64_t frames);

  /// Appends one frame of the format's size and type.
  void append(const FrameView& frame, const FrameHeader& header);

  std::int64_t frames() const { return static_cast<std::int64_t>(headers_.size()); }

  /// Says what commit() shall write as table TRUTH. An empty list makes an empty table.
  void write_truth(std::span<const TruthVortex> truth);

  /// Completes the file; afterwards only frames() may be called. Throws Failure, and leaves nothing
  /// behind, if no frame was appended, if a compressed file did not get as many frames as it is
  /// for, or if the disk is full.
  void commit();

 private:
  RecordingWriter(FitsFile file, const FrameFormat& format, std::int64_t compressed_frames)
      : file_(std::move(file)), format_(format), compressed_frames_(compressed_frames) {}

  FitsFile file_;
  FrameFormat format_;
  std::int64_t compressed_frames_ = 0;  ///< 0 if not compressed
  FrameColumns headers_;
  std::vector<TruthVortex> truth_;
  bool has_truth_ = false;
};

/// Returns the table TRUTH of a recording, in file order; nullopt if it has none. Only simulated
/// recordings have one.
std::optional<std::vector<TruthVortex>> read_truth(const std::string& path);

}  // namespace curlew
