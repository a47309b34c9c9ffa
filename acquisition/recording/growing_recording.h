// GrowingRecording: a recording that can be read at every moment while it grows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/recording_hdus.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Writes the Recording format of DESIGN.md so that whoever opens the file, also after this process
/// was killed, finds a FITS file with all frames of the last commit() and their table:
///
///     cube of the committed frames | FRAMES | UNFINISHED, an image over the space behind
///
/// New frames go into that space. commit() writes the next table and UNFINISHED behind them, then,
/// all at once, the frames' part where the old table was and the key NAXIS3. Whoever is killed
/// between these last two, some 20 µs, leaves the cube without the table. A file gets its name by
/// the first commit(). Data survive the process, not a loss of power.
///
/// All errors are Failure naming the file, which then ends with the last commit(). Not for two
/// threads at once. Keeps 28 bytes a frame in memory.
class GrowingRecording {
 public:
  /// Arguments as of RecordingWriter. Failure also where the file exists.
  GrowingRecording(const std::string& path, const FrameFormat& format, const Optics& optics,
                   const Detector& detector, const std::string& program);

  /// Cuts off what was not committed; with it UNFINISHED goes, and a file without a frame.
  ~GrowingRecording();
  GrowingRecording(const GrowingRecording&) = delete;
  GrowingRecording& operator=(const GrowingRecording&) = delete;

  /// Appends one frame of the format's size and type; commits by itself when the space ends.
  void append(const FrameView& frame, const FrameHeader& header);

  /// Shows all frames to readers.
  void commit();

  const std::string& path() const { return path_; }
  std::int64_t frames() const { return committed_ + static_cast<std::int64_t>(pending_.size()); }
  std::int64_t committed() const { return committed_; }
  /// Of the file, once all frames are committed.
  std::int64_t bytes() const;

 private:
  void encode(const FrameView& frame);
  void lay_out_tail();
  void write(std::span<const std::byte> bytes, std::int64_t offset);
  void resize(std::int64_t bytes);
  void publish();
  [[noreturn]] void fail(int error) const;

  std::string path_;
  std::string partial_;  ///< its name until the first commit; then empty
  FrameFormat format_;
  FitsFile model_;  ///< in memory: the file's header, table and UNFINISHED, without any pixel
  int file_ = -1;
  std::int64_t head_bytes_ = 0;   ///< of the primary header
  std::int64_t spare_bytes_ = 0;  ///< of UNFINISHED's pixels, a hole until frames come

  std::int64_t committed_ = 0;      ///< frames
  std::int64_t committed_end_ = 0;  ///< of their pixels in the file
  std::int64_t tail_end_ = 0;       ///< of table and UNFINISHED's header
  bool tail_is_whole_ = true;       ///< false while it is overwritten

  FrameColumns pending_;          ///< headers of the frames since the last commit
  std::int64_t pending_end_ = 0;  ///< of their pixels in the file
  std::vector<std::byte> held_;   ///< those of their pixels that belong where the tail is
  std::vector<std::byte> encoded_;
  std::vector<std::byte> tail_;  ///< the next one, with the padding before it
};

}  // namespace curlew
