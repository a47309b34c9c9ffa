#include "service/results/json_lines.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"

namespace curlew {
namespace {

/// Returns the shortest decimals that read back as the same float, or null for a number that is not
/// finite, because JSON has none.
nlohmann::json number(float value) {
  if (!std::isfinite(value)) return nullptr;
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value);
  double shortest = 0.0;
  std::from_chars(text, end.ptr, shortest);
  return shortest;
}

constexpr std::size_t kBufferBytes = 1 << 16;

nlohmann::json microseconds(std::int64_t ns) { return static_cast<double>(ns) / 1000.0; }

}  // namespace

JsonLines::JsonLines(const std::string& path, JsonLinesFile file) : path_(path) {
  namespace fs = std::filesystem;
  std::error_code none;
  const std::string target = target_of(path);
  stream_only_ = fs::exists(path, none) && !fs::is_regular_file(target, none);
  in_place_ = stream_only_ || file == JsonLinesFile::kGrowing;
  if (!stream_only_) path_ = target;
  writing_path_ = in_place_ ? path : partial_path(target);
  // The daemon does not wait until somebody reads a pipe; replay does, as writers of pipes usually
  // do.
  const bool waits = file == JsonLinesFile::kComplete;
  const int how = stream_only_ ? (waits ? 0 : O_NONBLOCK) : in_place_ ? O_APPEND : O_TRUNC;
  fd_ = open(writing_path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | how, 0666);
  if (fd_ < 0) refuse(errno);
}

JsonLines::~JsonLines() {
  if (fd_ >= 0) close(fd_);
  if (in_place_ || writing_path_.empty()) return;
  std::error_code none;
  std::filesystem::remove(writing_path_, none);
}

void JsonLines::add(const FrameResult& result) {
  const FrameHeader& header = result.header;
  nlohmann::ordered_json line;
  line["frame"] = result.frame_index;
  line["sequence"] = header.sequence;
  line["camera_ns"] = header.camera_ns;
  line["received_ns"] = header.received_ns;
  line["dropped"] = result.dropped;
  line["status"] = header.status;
  line["n_valid"] = result.n_valid;
  line["n_lost"] = result.n_lost;
  line["n_islands"] = result.n_islands;
  auto& vortices = line["vortices"] = nlohmann::ordered_json::array();
  for (const Vortex& v : result.vortices) {
    const auto pixel =
        result.grid.pixel_from_lenslet(static_cast<double>(v.x), static_cast<double>(v.y));
    vortices.push_back(
        {{"x", number(v.x)},
         {"y", number(v.y)},
         {"charge", v.charge},
         {"circulation", number(v.circulation)},
         {"significance", number(v.significance)},
         {"x_px", pixel[0]},
         {"y_px", pixel[1]},
         {"flags", v.flags},
         {"track", v.track},
         {"probability", v.probability < 0.0F ? nlohmann::json(nullptr) : number(v.probability)},
         {"vx", number(v.velocity_x)},
         {"vy", number(v.velocity_y)}});
  }
  auto& latency = line["latency_us"] = nlohmann::ordered_json::object();
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    latency[kStages[stage].name] = microseconds(result.latency.stage_ns[stage]);
  latency["publish"] = microseconds(result.latency.publish_ns);
  latency["total"] = microseconds(result.latency.total_ns);
  buffer_ += line.dump();
  buffer_ += '\n';
  if (stream_only_ || buffer_.size() >= kBufferBytes) write_out();
}

void JsonLines::flush() { write_out(); }

void JsonLines::commit() {
  write_out();
  if (close(std::exchange(fd_, -1)) != 0) refuse(errno);
  if (in_place_) return;
  std::error_code error;
  std::filesystem::rename(writing_path_, path_, error);
  if (error) throw Failure(path_ + " cannot be written: " + error.message());
  writing_path_.clear();
}

void JsonLines::write_out() {
  constexpr int kLookUpMs = 100;
  std::size_t written = 0;
  while (written < buffer_.size()) {
    const ssize_t count = ::write(fd_, buffer_.data() + written, buffer_.size() - written);
    if (count >= 0) {
      written += static_cast<std::size_t>(count);
    } else if (errno == EAGAIN && !given_up_) {
      pollfd room{fd_, POLLOUT, 0};
      poll(&room, 1, kLookUpMs);
    } else if (errno != EINTR) {
      refuse(errno);
    }
  }
  buffer_.clear();
}

void JsonLines::refuse(int error) const {
  const std::string what = error == EAGAIN  ? "its reader does not read"
                           : error == ENXIO ? "nobody reads this pipe"
                                            : std::generic_category().message(error) +
                                                  "; is the disk full or the folder missing?";
  throw Failure(path_ + " cannot be written: " + what);
}

}  // namespace curlew
