#include "acquisition/recording/recording_hdus.h"

#include <array>
#include <span>

#include "acquisition/recording/recording_keys.h"
#include "core/error.h"

namespace curlew {
namespace {

std::string size_text(int rows, int cols, PixelType type) {
  return std::to_string(rows) + " x " + std::to_string(cols) + " pixels of " +
         (type == PixelType::kU8 ? "8" : "16") + " bits";
}

}  // namespace

void create_recording_image(FitsFile& file, const FrameFormat& format, const Optics& optics,
                            const Detector& detector, const Provenance& provenance,
                            std::int64_t frames, Compression compression) {
  if (format.scale_adu != 1.0 || format.zero_adu != 0.0) {
    throw Failure(file.path() +
                  " cannot be recorded: its frames are not in plain ADU, record the source");
  }
  const ElementType element =
      format.pixel_type == PixelType::kU8 ? ElementType::kU8 : ElementType::kU16;
  const std::vector<std::int64_t> shape{frames, format.rows, format.cols};
  if (compression == Compression::kRice) {
    file.create_compressed_image(element, shape, "adu");
  } else {
    file.create_image(element, shape, "", "adu");
  }
  write_optics(file, optics);
  write_detector(file, detector);
  write_region(file, format);
  write_provenance(file, provenance);
}

void require_format(const std::string& path, const FrameFormat& format, const FrameView& frame) {
  if (frame.rows == format.rows && frame.cols == format.cols &&
      frame.pixel_type == format.pixel_type) {
    return;
  }
  throw Failure(path + " is a recording of " +
                size_text(format.rows, format.cols, format.pixel_type) + ", and a frame has " +
                size_text(frame.rows, frame.cols, frame.pixel_type));
}

void FrameColumns::add(const FrameHeader& header) {
  sequence.push_back(header.sequence);
  camera_ns.push_back(header.camera_ns);
  received_ns.push_back(header.received_ns);
  status.push_back(static_cast<std::int32_t>(header.status));
}

void FrameColumns::clear() {
  sequence.clear();
  camera_ns.clear();
  received_ns.clear();
  status.clear();
}

void create_frame_table(FitsFile& file) {
  const std::array<ColumnSpec, 4> columns{{{"SEQUENCE", 'K', ""},
                                           {"CAMERA_NS", 'K', "ns"},
                                           {"RECEIVED_NS", 'K', "ns"},
                                           {"STATUS", 'J', ""}}};
  file.create_table("FRAMES", columns);
}

void write_frame_rows(FitsFile& file, std::int64_t first_row, const FrameColumns& rows) {
  const auto write = [&](const std::string& name, const auto& values) {
    file.write_column(name, first_row, std::span(values));
  };
  write("SEQUENCE", rows.sequence);
  write("CAMERA_NS", rows.camera_ns);
  write("RECEIVED_NS", rows.received_ns);
  write("STATUS", rows.status);
}

}  // namespace curlew
