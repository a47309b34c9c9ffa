#include "acquisition/recording/fits_source.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <span>
#include <utility>

#include "acquisition/recording/milk_recording.h"
#include "acquisition/recording/pixel_range.h"
#include "core/error.h"
#include "core/stop_request.h"

namespace curlew {
namespace {

std::string number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.7g", value);
  return text.data();
}

std::string place_text(const FrameFormat& region) {
  return "offset (" + std::to_string(region.offset_x_px) + ", " +
         std::to_string(region.offset_y_px) + "), binning " + std::to_string(region.binning);
}

void require_alike(const FitsCube& first, const FitsCube& other) {
  if (first.region.rows != other.region.rows || first.region.cols != other.region.cols ||
      first.element != other.element) {
    throw Failure(other.file.path() + " has frames of " + other.description() + " and " +
                  first.file.path() + " of " + first.description() +
                  ": files replayed together must be alike");
  }
  if (first.signed_pixels != other.signed_pixels) {
    throw Failure(
        other.file.path() + " and " + first.file.path() +
        " hold 16-bit integers of which only one seems to have lost its key BZERO: replay "
        "them apart");
  }
  if (place_text(first.region) != place_text(other.region)) {
    throw Failure(other.file.path() + " has " + place_text(other.region) + " and " +
                  first.file.path() + " " + place_text(first.region) +
                  ": files replayed together must be alike");
  }
}

}  // namespace

FitsSource::FitsSource(std::vector<std::string> paths, FrameSelection selection)
    : paths_(std::move(paths)), selection_(std::move(selection)) {
  if (paths_.empty()) throw UsageError("no FITS file to replay was named");
  const FitsCube first = FitsCube::open(paths_.front(), selection_);
  bool has_undefined = first.has_undefined;
  frame_count_ = first.frames;
  notes_ = first.notes;
  for (std::size_t i = 1; i < paths_.size(); ++i) {
    const FitsCube other = FitsCube::open(paths_[i], selection_);
    require_alike(first, other);
    has_undefined = has_undefined || other.has_undefined;
    frame_count_ += other.frames;
    if (other.hdus != first.hdus || first.notes.empty())
      notes_.insert(notes_.end(), other.notes.begin(), other.notes.end());
  }
  if (first.pictures && !std::is_sorted(paths_.begin(), paths_.end(), comes_before)) {
    notes_.emplace_back(
        "The pictures are read in the order in which they were named, which is not that of the "
        "numbers in their names; a pattern in quotes, or the directory, is read in that.");
  }
  format_ = first.region;
  optics_ = first.optics;
  detector_ = first.detector;

  if (!has_undefined && first.element == ElementType::kU8) {
    reading_ = Reading::kU8;
    format_.pixel_type = PixelType::kU8;
  } else if (!has_undefined && first.element == ElementType::kU16) {
    reading_ = Reading::kU16;
  } else if (!has_undefined && first.element == ElementType::kI16 &&
             first.signed_pixels == SignedPixels::kWrapped) {
    reading_ = Reading::kWrapped;
  } else if (!has_undefined && first.element == ElementType::kI16 &&
             first.signed_pixels == SignedPixels::kShifted) {
    reading_ = Reading::kI16;
  } else if (!has_undefined && first.element == ElementType::kI16) {
    reading_ = Reading::kI16;
    format_.zero_adu = -32768.0;
    map_report_ = "Signed 16-bit pixels become unsigned: ADU = count - 32768.";
  } else {
    choose_map();
  }
}

void FitsSource::choose_map() {
  values_ = Image<double>(format_.rows, format_.cols);
  Image<std::uint8_t> bad(format_.rows, format_.cols);
  PixelRange range;
  for (const std::string& path : paths_) {
    FitsCube cube = FitsCube::open(path, selection_);
    std::size_t finite_in_file = 0;
    for (std::int64_t n = 0; n < cube.frames; ++n) {
      refuse_if_stopped(path);
      cube.read_values(n, std::span(values_.data(), values_.size()));
      const std::size_t finite = range.add(values_);
      finite_in_file += finite;
      if (finite == 0 || finite == values_.size()) continue;
      for (std::size_t k = 0; k < values_.size(); ++k) {
        if (!std::isfinite(values_[k])) bad[k] = 1;
      }
    }
    if (finite_in_file == 0)
      throw Failure(path + " holds no finite pixel: all are NaN or undefined");
  }
  const auto n_bad = std::count(bad.begin(), bad.end(), std::uint8_t{1});
  if (static_cast<std::size_t>(n_bad) == bad.size()) {
    throw Failure(paths_.front() + " has no pixel that is finite in all frames");
  }
  if (!std::isfinite(range.max() - range.min())) {
    throw Failure(paths_.front() + " has pixels from " + number(range.min()) + " to " +
                  number(range.max()) + ", too far apart to be counts");
  }
  const PixelMap map = range.choose_map();
  format_.scale_adu = map.scale;
  format_.zero_adu = map.min;
  const FarPixels far = map.leaves_out ? find_far_pixels(map, bad) : FarPixels{};
  if (n_bad + far.bad > 0) nan_pixels_ = std::move(bad);
  report_map(map, n_bad, far);
}

// Marks as bad the pixels that are outside the map in all frames.
FitsSource::FarPixels FitsSource::find_far_pixels(const PixelMap& map, Image<std::uint8_t>& bad) {
  Image<std::int64_t> times(format_.rows, format_.cols);
  std::int64_t frames = 0;
  for (const std::string& path : paths_) {
    FitsCube cube = FitsCube::open(path, selection_);
    for (std::int64_t n = 0; n < cube.frames; ++n) {
      refuse_if_stopped(path);
      cube.read_values(n, std::span(values_.data(), values_.size()));
      bool any = false;
      for (std::size_t k = 0; k < values_.size(); ++k) {
        if (!std::isfinite(values_[k])) continue;
        any = true;
        if (!map.holds(values_[k])) ++times[k];
      }
      frames += any ? 1 : 0;
    }
  }
  FarPixels far;
  for (std::size_t k = 0; k < times.size(); ++k) {
    if (times[k] == 0 || bad[k] != 0) continue;
    if (times[k] == frames) {
      bad[k] = 1;
      ++far.bad;
    } else {
      far.clipped += times[k];
    }
  }
  return far;
}

void FitsSource::report_map(const PixelMap& map, std::int64_t not_finite, const FarPixels& far) {
  const auto count = [](std::int64_t n, const std::string& one, const std::string& many) {
    return "; " + std::to_string(n) + (n == 1 ? one : many);
  };
  map_report_ = "Pixels from " + number(map.min) + " to " + number(map.max) +
                " are mapped to 16 bits: ADU = " + number(format_.zero_adu) + " + " +
                number(format_.scale_adu) + " * count";
  if (not_finite > 0)
    map_report_ += count(not_finite, " pixel that is not finite in some frame is bad",
                         " pixels that are not finite in some frame are bad");
  if (far.bad > 0)
    map_report_ += count(far.bad, " pixel that is far outside this range in all frames is bad",
                         " pixels that are far outside this range in all frames are bad");
  if (far.clipped > 0)
    map_report_ += count(far.clipped, " value far outside, in some frames only, is clipped",
                         " values far outside, in some frames only, are clipped");
  map_report_ += ".";
}

bool FitsSource::open_next_file() {
  if (next_path_ == paths_.size()) return false;
  cube_.emplace(FitsCube::open(paths_[next_path_++], selection_));
  if (cube_->region.rows != format_.rows || cube_->region.cols != format_.cols) {
    throw Failure(cube_->file.path() + " has changed while it was replayed");
  }
  frame_in_file_ = 0;
  read_frame_table();
  return true;
}

void FitsSource::read_frame_table() {
  table_ = FrameTable{};
  FitsFile& file = cube_->file;
  if (file.try_select("FRAMES")) {
    const auto rows = static_cast<std::size_t>(
        std::clamp<std::int64_t>(file.whole_row_count(), 0, cube_->frames));
    const auto read = [&](const std::string& name, auto& values) {
      if (!file.has_column(name)) return;
      values.resize(rows);
      file.read_column(name, 0, std::span(values));
    };
    read("SEQUENCE", table_.sequence);
    read("CAMERA_NS", table_.camera_ns);
    read("RECEIVED_NS", table_.received_ns);
    read("STATUS", table_.status);
  } else if (auto times = read_milk_times(file.path())) {
    table_.sequence = std::move(times->sequence);
    table_.camera_ns = std::move(times->camera_ns);
    table_.received_ns = std::move(times->received_ns);
  }
  file.select(cube_->hdus.front());
}

/// Passes to the next frame, which is frame_in_file_ - 1 then, and numbers it. Returns false at the
/// end.
bool FitsSource::next_header(FrameHeader& header) {
  if ((!cube_ || frame_in_file_ == cube_->frames) && !open_next_file()) {
    cube_.reset();
    return false;
  }
  const auto n = static_cast<std::size_t>(frame_in_file_);
  const auto value_or = [n](const auto& column, auto otherwise) {
    return n < column.size() ? column[n] : otherwise;
  };
  header.sequence = value_or(table_.sequence, next_sequence_);
  header.renumbered = frame_in_file_ == 0;
  header.camera_ns = value_or(table_.camera_ns, std::int64_t{0});
  header.received_ns = value_or(table_.received_ns, std::int64_t{0});
  header.status = static_cast<std::uint32_t>(value_or(table_.status, std::int32_t{0}));
  // A file may say anything; after the last number comes 0.
  constexpr auto kLast = std::numeric_limits<std::int64_t>::max();
  next_sequence_ = header.sequence == kLast ? 0 : header.sequence + 1;
  ++frame_in_file_;
  return true;
}

void FitsSource::skip(std::int64_t frames) {
  FrameHeader header;
  while (frames-- > 0 && next_header(header)) {
  }
}

Delivery FitsSource::next(FrameBuffer& into) {
  if (into.format().bytes() != format_.bytes()) {
    throw Failure(paths_.front() + " has frames of " + std::to_string(format_.bytes()) +
                  " bytes, and the buffer takes " + std::to_string(into.format().bytes()));
  }
  FrameHeader& header = into.header;
  if (!next_header(header)) return Delivery::kEnd;
  read_pixels(into);
  header.received = std::chrono::steady_clock::now();
  into.rows_ready.store(format_.rows, std::memory_order_release);
  return Delivery::kFrame;
}

void FitsSource::read_pixels(FrameBuffer& into) {
  const std::int64_t frame = frame_in_file_ - 1;
  const std::size_t n = format_.pixels();
  auto* counts = reinterpret_cast<std::uint16_t*>(into.data());
  switch (reading_) {
    case Reading::kU8:
      cube_->read_frame(frame, std::span(reinterpret_cast<std::uint8_t*>(into.data()), n));
      return;
    case Reading::kU16:
      cube_->read_frame(frame, std::span(counts, n));
      return;
    case Reading::kWrapped:
      cube_->read_frame(frame, std::span(reinterpret_cast<std::int16_t*>(into.data()), n));
      return;
    case Reading::kI16:
      cube_->read_frame(frame, std::span(reinterpret_cast<std::int16_t*>(into.data()), n));
      // This adds 32768 in two's complement.
      for (std::size_t k = 0; k < n; ++k)
        counts[k] = static_cast<std::uint16_t>(counts[k] ^ 0x8000U);
      return;
    case Reading::kMapped:
      break;
  }
  cube_->read_values(frame, std::span(values_.data(), values_.size()));
  const double counts_per_adu = 1.0 / format_.scale_adu;
  std::size_t finite = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const double value = values_[k];
    const bool is_finite = std::isfinite(value);
    const double count = (value - format_.zero_adu) * counts_per_adu + 0.5;
    counts[k] = is_finite ? static_cast<std::uint16_t>(std::clamp(count, 0.0, kMaxCount)) : 0;
    finite += is_finite ? 1U : 0U;
  }
  if (finite == 0) into.header.status |= kFrameIncomplete;
}

}  // namespace curlew
