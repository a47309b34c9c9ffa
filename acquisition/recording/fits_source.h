// A FitsSource gives frames from recordings and from anybody's FITS files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/frame_source.h"
#include "acquisition/recording/fits_cube.h"
#include "acquisition/recording/frame_selection.h"
#include "acquisition/recording/pixel_range.h"
#include "core/frame.h"
#include "core/image.h"
#include "core/optics.h"

namespace curlew {

/// Delivers the frames of one or more files, one after the other, as fast as they are asked for.
///
/// Unsigned 8- and 16-bit images pass untouched, and signed 16-bit ones become unsigned with zero
/// −32768, or as FitsCube::signed_pixels says. All others (32-bit, float, integers with undefined
/// pixels) are read once in the constructor for their range and are mapped to 16 bits by one affine
/// map for all files, see PixelRange. NaN, infinite and undefined pixels are bad; they get count 0.
/// So are pixels that are far outside the map in all frames; if they are so in some only, their
/// values are clipped. A frame without any finite pixel is delivered with kFrameIncomplete and
/// makes no pixel bad.
///
/// Frame headers come from the table FRAMES, or from milk's text of times beside the file. Where
/// those are missing or short, the sequence counts on from the frame before (from 0), status is 0
/// and the times are unknown (0).
class FitsSource : public FrameSource {
 public:
  /// selection: what is read of each file. Throws UsageError if no path is given. Throws Failure
  /// for whatever FitsCube::open refuses, for files that differ in size, type, offset or binning,
  /// for a file without any finite pixel, if no pixel is finite in all frames, and for values too
  /// far apart for a double.
  explicit FitsSource(std::vector<std::string> paths, FrameSelection selection = {});

  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return frame_count_; }
  /// into: made with this source's format(). The function allocates only when it passes to the next
  /// file, and for tile-compressed images.
  Delivery next(FrameBuffer& into) override;
  /// Passes over so many frames, whose pixels are not read. Those that come after them are numbered
  /// as if they had been.
  void skip(std::int64_t frames);

  /// These come from the first file's keys; what the keys do not say keeps its default (mostly
  /// NaN).
  const Optics& optics() const { return optics_; }
  const Detector& detector() const { return detector_; }
  /// Returns 1 where a pixel is not a finite number in some frame, or far outside the map in all,
  /// [rows, cols]; empty if there is no such pixel.
  const Image<std::uint8_t>& nan_pixels() const { return nan_pixels_; }
  /// Returns one sentence on how pixel values became counts; empty if they pass untouched.
  const std::string& map_report() const { return map_report_; }
  /// Returns sentences on which images and which part of them are read; empty if that was plain.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  enum class Reading { kU8, kU16, kI16, kWrapped, kMapped };
  /// Counts what lies outside the map.
  struct FarPixels {
    std::int64_t bad = 0;      ///< pixels that do so in all frames
    std::int64_t clipped = 0;  ///< values of other pixels
  };
  /// Holds the columns of one file's FRAMES table; each is as long as the rows that are there, or
  /// empty.
  struct FrameTable {
    std::vector<std::int64_t> sequence;
    std::vector<std::int64_t> camera_ns;
    std::vector<std::int64_t> received_ns;
    std::vector<std::int32_t> status;
  };

  void choose_map();
  FarPixels find_far_pixels(const PixelMap& map, Image<std::uint8_t>& bad);
  void report_map(const PixelMap& map, std::int64_t not_finite, const FarPixels& far);
  bool open_next_file();
  bool next_header(FrameHeader& header);
  void read_frame_table();
  void read_pixels(FrameBuffer& into);

  std::vector<std::string> paths_;
  FrameSelection selection_;
  FrameFormat format_;
  Optics optics_;
  Detector detector_;
  std::int64_t frame_count_ = 0;
  Reading reading_ = Reading::kMapped;
  Image<std::uint8_t> nan_pixels_;
  std::string map_report_;
  std::vector<std::string> notes_;

  std::size_t next_path_ = 0;
  std::optional<FitsCube> cube_;  ///< the file being read
  FrameTable table_;
  std::int64_t frame_in_file_ = 0;
  std::int64_t next_sequence_ = 0;
  Image<double> values_;  ///< physical values of one frame, if mapped
};

}  // namespace curlew
