#include "acquisition/recording/fits_source.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <utility>

#include "core/error.h"

namespace curlew {
namespace {

constexpr double kMaxCount = 65535.0;
// From this span on, rounding to whole ADU loses less than most detectors' own noise.
constexpr double kWideSpan = 4096.0;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Holds what the scan of all values finds out.
struct Range {
  double min = kInfinity;
  double max = -kInfinity;
  bool whole_numbers = true;

  bool any() const { return min <= max; }
};

// Adds one frame to the range and counts its finite values.
std::size_t scan(const Image<double>& values, Range& range) {
  std::size_t finite = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    ++finite;
    range.min = std::min(range.min, value);
    range.max = std::max(range.max, value);
    range.whole_numbers = range.whole_numbers && value == std::trunc(value);
  }
  return finite;
}

double choose_scale(const Range& range) {
  const double span = range.max - range.min;
  if (span <= kMaxCount && (range.whole_numbers || span >= kWideSpan)) return 1.0;
  const double scale = span / kMaxCount;
  // If all values are equal, or nearly, there is no scale to choose.
  return scale >= std::numeric_limits<double>::min() ? scale : 1.0;
}

std::string number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.7g", value);
  return text.data();
}

std::string region_text(const FrameFormat& region) {
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
  if (region_text(first.region) != region_text(other.region)) {
    throw Failure(other.file.path() + " has " + region_text(other.region) + " and " +
                  first.file.path() + " " + region_text(first.region) +
                  ": files replayed together must be alike");
  }
}

}  // namespace

FitsSource::FitsSource(std::vector<std::string> paths) : paths_(std::move(paths)) {
  if (paths_.empty()) throw UsageError("no FITS file to replay was named");
  const FitsCube first = FitsCube::open(paths_.front());
  bool has_undefined = first.has_undefined;
  frame_count_ = first.frames;
  for (std::size_t i = 1; i < paths_.size(); ++i) {
    const FitsCube other = FitsCube::open(paths_[i]);
    require_alike(first, other);
    has_undefined = has_undefined || other.has_undefined;
    frame_count_ += other.frames;
  }
  format_ = first.region;
  optics_ = first.optics;
  detector_ = first.detector;

  if (!has_undefined && first.element == ElementType::kU8) {
    reading_ = Reading::kU8;
    format_.pixel_type = PixelType::kU8;
  } else if (!has_undefined && first.element == ElementType::kU16) {
    reading_ = Reading::kU16;
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
  Range range;
  for (const std::string& path : paths_) {
    FitsCube cube = FitsCube::open(path);
    std::size_t finite_in_file = 0;
    for (std::int64_t n = 0; n < cube.frames; ++n) {
      cube.read_frame(n, std::span(values_.data(), values_.size()));
      const std::size_t finite = scan(values_, range);
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
  if (!std::isfinite(range.max - range.min)) {
    throw Failure(paths_.front() + " has pixels from " + number(range.min) + " to " +
                  number(range.max) + ", too far apart to be counts");
  }
  if (n_bad > 0) nan_pixels_ = std::move(bad);
  format_.scale_adu = choose_scale(range);
  format_.zero_adu = range.min;
  map_report_ = "Pixels from " + number(range.min) + " to " + number(range.max) +
                " are mapped to 16 bits: ADU = " + number(format_.zero_adu) + " + " +
                number(format_.scale_adu) + " * count.";
  if (n_bad > 0) {
    map_report_.pop_back();
    map_report_ += "; " + std::to_string(n_bad) +
                   (n_bad == 1 ? " pixel that is" : " pixels that are") +
                   " not finite in some frame " + (n_bad == 1 ? "is" : "are") + " bad.";
  }
}

bool FitsSource::open_next_file() {
  if (next_path_ == paths_.size()) return false;
  cube_.emplace(FitsCube::open(paths_[next_path_++]));
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
  }
  file.select(cube_->hdu);
}

Delivery FitsSource::next(FrameBuffer& into) {
  if (into.format().bytes() != format_.bytes()) {
    throw Failure(paths_.front() + " has frames of " + std::to_string(format_.bytes()) +
                  " bytes, and the buffer takes " + std::to_string(into.format().bytes()));
  }
  if (!cube_ || frame_in_file_ == cube_->frames) {
    if (!open_next_file()) {
      cube_.reset();
      return Delivery::kEnd;
    }
  }
  const auto n = static_cast<std::size_t>(frame_in_file_);
  const auto value_or = [n](const auto& column, auto otherwise) {
    return n < column.size() ? column[n] : otherwise;
  };
  FrameHeader& header = into.header;
  header.sequence = value_or(table_.sequence, next_sequence_);
  header.renumbered = frame_in_file_ == 0;
  header.camera_ns = value_or(table_.camera_ns, std::int64_t{0});
  header.received_ns = value_or(table_.received_ns, std::int64_t{0});
  header.status = static_cast<std::uint32_t>(value_or(table_.status, std::int32_t{0}));
  read_pixels(into);
  header.received = std::chrono::steady_clock::now();
  into.rows_ready.store(format_.rows, std::memory_order_release);
  next_sequence_ = header.sequence + 1;
  ++frame_in_file_;
  return Delivery::kFrame;
}

void FitsSource::read_pixels(FrameBuffer& into) {
  const std::size_t n = format_.pixels();
  auto* counts = reinterpret_cast<std::uint16_t*>(into.data());
  switch (reading_) {
    case Reading::kU8:
      cube_->read_frame(frame_in_file_, std::span(reinterpret_cast<std::uint8_t*>(into.data()), n));
      return;
    case Reading::kU16:
      cube_->read_frame(frame_in_file_, std::span(counts, n));
      return;
    case Reading::kI16:
      cube_->read_frame(frame_in_file_, std::span(reinterpret_cast<std::int16_t*>(into.data()), n));
      // This adds 32768 in two's complement.
      for (std::size_t k = 0; k < n; ++k)
        counts[k] = static_cast<std::uint16_t>(counts[k] ^ 0x8000U);
      return;
    case Reading::kMapped:
      break;
  }
  cube_->read_frame(frame_in_file_, std::span(values_.data(), values_.size()));
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
