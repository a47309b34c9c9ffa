#include "acquisition/recording.h"

#include <array>
#include <cstddef>

#include "acquisition/recording_keys.h"
#include "core/error.h"

namespace curlew {
namespace {

std::string size_text(int rows, int cols, PixelType type) {
  return std::to_string(rows) + " x " + std::to_string(cols) + " pixels of " +
         (type == PixelType::kU8 ? "8" : "16") + " bits";
}

// One member of every row, as a column.
template <typename T, typename Member>
std::vector<T> column(std::span<const TruthVortex> rows, Member member) {
  std::vector<T> values;
  values.reserve(rows.size());
  for (const TruthVortex& row : rows) values.push_back(row.*member);
  return values;
}

template <typename T>
void write_all(FitsFile& file, const std::string& name, const std::vector<T>& values) {
  file.write_column(name, 0, std::span<const T>(values));
}

}  // namespace

RecordingWriter::RecordingWriter(const std::string& path, const FrameFormat& format,
                                 const Optics& optics, const Detector& detector,
                                 const std::string& program)
    : file_(FitsFile::create(path)), format_(format) {
  if (format.scale_adu != 1.0 || format.zero_adu != 0.0) {
    throw Failure(path + " cannot be recorded: its frames are not in plain ADU, record the source");
  }
  // The number of frames is written by commit().
  file_.create_image(format.pixel_type == PixelType::kU8 ? ElementType::kU8 : ElementType::kU16,
                     {0, format.rows, format.cols}, "", "adu");
  file_.write_key("CREATOR", program, "program that wrote this file");
  write_optics(file_, optics);
  write_detector(file_, detector);
  write_region(file_, format);
}

void RecordingWriter::append(const FrameView& frame, const FrameHeader& header) {
  if (frame.rows != format_.rows || frame.cols != format_.cols ||
      frame.pixel_type != format_.pixel_type) {
    throw Failure(file_.path() + " is a recording of " +
                  size_text(format_.rows, format_.cols, format_.pixel_type) + ", and a frame has " +
                  size_text(frame.rows, frame.cols, frame.pixel_type));
  }
  const std::size_t n = format_.pixels();
  const std::int64_t first = frames() * static_cast<std::int64_t>(n);
  if (format_.pixel_type == PixelType::kU8) {
    file_.write_pixels(first, std::span(frame.data<std::uint8_t>(), n));
  } else {
    file_.write_pixels(first, std::span(frame.data<std::uint16_t>(), n));
  }
  sequence_.push_back(header.sequence);
  camera_ns_.push_back(header.camera_ns);
  received_ns_.push_back(header.received_ns);
  status_.push_back(static_cast<std::int32_t>(header.status));
}

void RecordingWriter::write_truth(std::span<const TruthVortex> truth) {
  truth_.assign(truth.begin(), truth.end());
  has_truth_ = true;
}

void RecordingWriter::commit() {
  if (frames() == 0) {
    throw Failure(file_.path() + " is not written: there was no frame to record");
  }
  file_.resize_planes(frames());

  const std::array<ColumnSpec, 4> frame_columns{{{"SEQUENCE", 'K', ""},
                                                 {"CAMERA_NS", 'K', "ns"},
                                                 {"RECEIVED_NS", 'K', "ns"},
                                                 {"STATUS", 'J', ""}}};
  file_.create_table("FRAMES", frame_columns);
  write_all(file_, "SEQUENCE", sequence_);
  write_all(file_, "CAMERA_NS", camera_ns_);
  write_all(file_, "RECEIVED_NS", received_ns_);
  write_all(file_, "STATUS", status_);

  if (has_truth_) {
    const std::array<ColumnSpec, 5> truth_columns{{{"FRAME", 'K', ""},
                                                   {"X", 'D', ""},
                                                   {"Y", 'D', ""},
                                                   {"CHARGE", 'J', ""},
                                                   {"SEPARATION", 'D', ""}}};
    file_.create_table("TRUTH", truth_columns);
    file_.write_key("COORDS", std::string("X, Y, SEPARATION in lenslet pitches"));
    write_all(file_, "FRAME", column<std::int64_t>(truth_, &TruthVortex::frame));
    write_all(file_, "X", column<double>(truth_, &TruthVortex::x));
    write_all(file_, "Y", column<double>(truth_, &TruthVortex::y));
    write_all(file_, "CHARGE", column<std::int32_t>(truth_, &TruthVortex::charge));
    write_all(file_, "SEPARATION", column<double>(truth_, &TruthVortex::separation));
  }
  file_.commit();
}

std::optional<std::vector<TruthVortex>> read_truth(const std::string& path) {
  FitsFile file = FitsFile::open(path);
  if (!file.try_select("TRUTH")) return std::nullopt;
  const auto rows = static_cast<std::size_t>(file.whole_row_count());
  const auto read = [&]<typename T>(const std::string& name, T) {
    std::vector<T> values(rows);
    file.read_column(name, 0, std::span<T>(values));
    return values;
  };
  const auto frame = read("FRAME", std::int64_t{});
  const auto x = read("X", double{});
  const auto y = read("Y", double{});
  const auto charge = read("CHARGE", std::int32_t{});
  const auto separation = read("SEPARATION", double{});
  std::vector<TruthVortex> truth(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    truth[i] = {frame[i], x[i], y[i], charge[i], separation[i]};
  }
  return truth;
}

}  // namespace curlew
