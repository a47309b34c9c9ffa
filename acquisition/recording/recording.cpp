#include "acquisition/recording/recording.h"

#include <array>
#include <cstddef>

#include "acquisition/pictures/picture_stack.h"
#include "core/error.h"

namespace curlew {
namespace {

// Returns one member of every row, as a column.
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
                                 const Provenance& provenance)
    : RecordingWriter(FitsFile::create(path), format, 0) {
  // The number of frames is written by commit().
  create_recording_image(file_, format, optics, detector, provenance, 0);
}

RecordingWriter RecordingWriter::compressed(const std::string& path, const FrameFormat& format,
                                            const Optics& optics, const Detector& detector,
                                            const Provenance& provenance, std::int64_t frames) {
  RecordingWriter writer(FitsFile::create(path), format, frames);
  create_recording_image(writer.file_, format, optics, detector, provenance, frames,
                         Compression::kRice);
  return writer;
}

void RecordingWriter::append(const FrameView& frame, const FrameHeader& header) {
  require_format(file_.path(), format_, frame);
  const std::size_t n = format_.pixels();
  const std::int64_t first = frames() * static_cast<std::int64_t>(n);
  if (format_.pixel_type == PixelType::kU8) {
    file_.write_pixels(first, std::span(frame.data<std::uint8_t>(), n));
  } else {
    file_.write_pixels(first, std::span(frame.data<std::uint16_t>(), n));
  }
  headers_.add(header);
}

void RecordingWriter::write_truth(std::span<const TruthVortex> truth) {
  truth_.assign(truth.begin(), truth.end());
  has_truth_ = true;
}

void RecordingWriter::commit() {
  FitsFile file = std::move(file_);  // If this fails, what is written goes with it.
  if (frames() == 0) {
    throw Failure(file.path() + " is not written: there was no frame to record");
  }
  if (compressed_frames_ == 0) {
    file.resize_planes(frames());
  } else if (compressed_frames_ != frames()) {
    throw Failure(file.path() + " is not written: it was to have " +
                  std::to_string(compressed_frames_) + " frames and got " +
                  std::to_string(frames()));
  }
  create_frame_table(file);
  write_frame_rows(file, 0, headers_);

  if (has_truth_) {
    const std::array<ColumnSpec, 5> truth_columns{{{"FRAME", 'K', ""},
                                                   {"X", 'D', ""},
                                                   {"Y", 'D', ""},
                                                   {"CHARGE", 'J', ""},
                                                   {"SEPARATION", 'D', ""}}};
    file.create_table("TRUTH", truth_columns);
    file.write_key("COORDS", std::string("X, Y, SEPARATION in lenslet pitches"));
    write_all(file, "FRAME", column<std::int64_t>(truth_, &TruthVortex::frame));
    write_all(file, "X", column<double>(truth_, &TruthVortex::x));
    write_all(file, "Y", column<double>(truth_, &TruthVortex::y));
    write_all(file, "CHARGE", column<std::int32_t>(truth_, &TruthVortex::charge));
    write_all(file, "SEPARATION", column<double>(truth_, &TruthVortex::separation));
  }
  file.commit();
}

std::optional<std::vector<TruthVortex>> read_truth(const std::string& path) {
  if (means_pictures(path)) return std::nullopt;
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
