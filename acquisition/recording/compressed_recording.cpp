#include "acquisition/recording/compressed_recording.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/recording.h"
#include "core/error.h"

namespace curlew {
namespace {

bool same_frame(FrameBuffer& a, FrameBuffer& b) {
  return std::equal(a.data(), a.data() + a.format().bytes(), b.data()) &&
         a.header.sequence == b.header.sequence && a.header.camera_ns == b.header.camera_ns &&
         a.header.received_ns == b.header.received_ns && a.header.status == b.header.status;
}

enum class Comparison { kSame, kDifferent, kStopped };

Comparison compare(const std::string& raw, const std::string& compressed,
                   const std::stop_token& stop) {
  FitsSource expected({raw});
  FitsSource got({compressed});
  if (got.frame_count() != expected.frame_count() ||
      got.format().bytes() != expected.format().bytes()) {
    return Comparison::kDifferent;
  }
  FrameBuffer a(expected.format());
  FrameBuffer b(got.format());
  while (expected.next(a) == Delivery::kFrame) {
    if (stop.stop_requested()) return Comparison::kStopped;
    if (got.next(b) != Delivery::kFrame || !same_frame(a, b)) return Comparison::kDifferent;
  }
  return Comparison::kSame;
}

// Returns false if it was asked to stop; then there is no file.
bool write_compressed(const std::string& raw, const std::string& compressed,
                      const std::string& program, const std::stop_token& stop) {
  FitsSource source({raw});
  FitsFile file = FitsFile::open(raw);
  RecordingWriter writer =
      RecordingWriter::compressed(compressed, source.format(), source.optics(), source.detector(),
                                  read_provenance(file, program), source.frame_count());
  FrameBuffer frame(source.format());
  while (source.next(frame) == Delivery::kFrame) {
    if (stop.stop_requested()) return false;
    writer.append(frame.view(), frame.header);
  }
  writer.commit();
  return true;
}

}  // namespace

bool compress_recording(const std::string& raw, const std::string& compressed,
                        const std::string& program, const std::stop_token& stop) {
  if (!write_compressed(raw, compressed, program, stop)) return false;
  const auto remove = [&] {
    std::error_code ignored;
    std::filesystem::remove(compressed, ignored);
  };
  Comparison comparison{};
  try {
    comparison = compare(raw, compressed, stop);
  } catch (...) {
    remove();
    throw;
  }
  if (comparison != Comparison::kSame) remove();
  if (comparison == Comparison::kDifferent) {
    throw Failure(raw + " stays uncompressed: its compressed copy differs from it");
  }
  return comparison == Comparison::kSame;
}

}  // namespace curlew
