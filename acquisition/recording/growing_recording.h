// A GrowingRecording is a recording that can be read at every moment while it grows.
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

/// Writes a recording (docs/files.md) so that whoever opens the file, even after this process was
/// killed, finds a FITS file with all frames of the last commit() and their table:
///
///     cube of the committed frames | FRAMES | UNFINISHED, an image over the space behind
///
/// New frames go into that space. commit() writes the next table and UNFINISHED behind them. Then
/// it writes, one right after the other, the part of the frames that belongs where the old table
/// was, and the key NAXIS3. A process that is killed between these two, within some 20 µs, leaves
/// the cube without the table. The file gets its name by the first commit(). Data survive the
/// process, but not a loss of power.
///
/// All errors are Failure naming the file, which then ends with the last commit(). Two threads must
/// not use one at once. It keeps 28 bytes per frame in memory.
class GrowingRecording {
 public:
  /// The arguments are those of RecordingWriter. Throws Failure also if the file exists.
  GrowingRecording(const std::string& path, const FrameFormat& format, const Optics& optics,
                   const Detector& detector, const Provenance& provenance);

  /// Cuts off what was not committed, and UNFINISHED with it. A file without a committed frame is
  /// removed.
  ~GrowingRecording();
  GrowingRecording(const GrowingRecording&) = delete;
  GrowingRecording& operator=(const GrowingRecording&) = delete;

  /// Appends one frame of the format's size and type; commits by itself when the space ends.
  void append(const FrameView& frame, const FrameHeader& header);

  /// Shows all frames to readers.
  void commit();

  enum class Whereabouts {
    kHere,
    kMoved,    ///< It has another name, or its folder has.
    kRemoved,  ///< It has no name any more, and is gone once it is closed.
  };
  /// Says what others have done with the file.
  Whereabouts whereabouts() const;

  const std::string& path() const { return path_; }
  std::int64_t frames() const { return committed_ + static_cast<std::int64_t>(pending_.size()); }
  std::int64_t committed() const { return committed_; }
  /// Returns the bytes of the file once all frames are committed.
  std::int64_t bytes() const;

 private:
  void encode(const FrameView& frame);
  void lay_out_tail();
  void write(std::span<const std::byte> bytes, std::int64_t offset);
  void resize(std::int64_t bytes);
  void publish();
  [[noreturn]] void fail(int error) const;

  std::string path_;
  std::string partial_;  ///< the file's name until the first commit; then empty
  FrameFormat format_;
  FitsFile model_;  ///< the file's header, table and UNFINISHED in memory, without any pixel
  int file_ = -1;
  std::int64_t head_bytes_ = 0;   ///< size of the primary header
  std::int64_t spare_bytes_ = 0;  ///< size of UNFINISHED's pixels, a hole until frames come

  std::int64_t committed_ = 0;      ///< number of committed frames
  std::int64_t committed_end_ = 0;  ///< end of their pixels in the file
  std::int64_t tail_end_ = 0;       ///< end of the table and UNFINISHED's header
  bool tail_is_whole_ = true;       ///< false while it is overwritten

  FrameColumns pending_;            ///< headers of the frames since the last commit
  std::int64_t pending_end_ = 0;    ///< end of their pixels in the file
  std::vector<std::byte> held_;     ///< bytes that wait because they belong where the tail is
  std::vector<std::byte> encoded_;  ///< the pixels of one frame as FITS has them
  std::vector<std::byte> tail_;     ///< the next tail, with the padding before it
};

}  // namespace curlew
