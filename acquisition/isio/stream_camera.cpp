#include "acquisition/isio/stream_camera.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <mutex>
#include <sstream>
#include <thread>
#include <utility>

#include "acquisition/frame_numbering.h"
#include "acquisition/isio/mapped_stream.h"
#include "acquisition/recording/pixel_range.h"
#include "core/error.h"
#include "core/utc_now.h"

namespace curlew {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr double kMostCounts = 65535.0;

std::int64_t ns_of(const timespec& time) { return time.tv_sec * kNsPerS + time.tv_nsec; }

/// Returns the format of the stream's images. Float ones still lack their map.
FrameFormat shape_of(const MappedStream& stream) {
  const StreamMetadata& metadata = stream.metadata();
  const auto type = static_cast<StreamType>(metadata.datatype);
  if (type == StreamType::kF64)
    throw Failure("stream " + stream.path() +
                  " is of doubles; frames of u8, u16 and float are read");
  constexpr std::uint32_t kLongestSide = 65535;
  const bool is_image = metadata.naxis == 2 || (metadata.naxis == 3 && metadata.size[2] == 1);
  if (!is_image || std::max(metadata.size[0], metadata.size[1]) > kLongestSide)
    throw Failure("stream " + stream.path() + " has no frames of two axes, each up to 65535 px");
  FrameFormat format;
  format.cols = static_cast<int>(metadata.size[0]);
  format.rows = static_cast<int>(metadata.size[1]);
  format.pixel_type = type == StreamType::kU8 ? PixelType::kU8 : PixelType::kU16;
  return format;
}

/// Chooses the map of float pixels from the image that is in the stream: of scale 1 where that is
/// fine enough, and with zero 0 where no pixel is negative.
void choose_map(const MappedStream& stream, FrameFormat& format) {
  Image<double> image(format.rows, format.cols);
  const auto* pixels = reinterpret_cast<const float*>(stream.data());
  std::copy_n(pixels, image.size(), image.begin());
  PixelRange range;
  if (range.add(image) == 0 || range.min() == range.max()) return;
  const PixelMap seen = range.choose_map();
  const double span = seen.max - seen.min;
  const double low = seen.min >= 0.0 ? 0.0 : std::floor(seen.min - 0.25 * span);
  const double high = seen.max + 2.0 * span;
  if (seen.scale == 1.0 && seen.max - low <= kMostCounts) {
    format.zero_adu = low;
    return;
  }
  format.zero_adu = seen.min >= 0.0 ? 0.0 : seen.min - 0.25 * span;
  format.scale_adu = (high - format.zero_adu) / kMostCounts;
}

class StreamCamera final : public Camera {
 public:
  StreamCamera(MappedStream stream, ThreadStart thread_start)
      : stream_(std::move(stream)),
        thread_start_(std::move(thread_start)),
        format_(shape_of(stream_)),
        floats_(stream_.metadata().datatype == static_cast<std::uint8_t>(StreamType::kF32)) {
    if (floats_) choose_map(stream_, format_);
  }
  ~StreamCamera() override { stop(); }
  StreamCamera(const StreamCamera&) = delete;
  StreamCamera& operator=(const StreamCamera&) = delete;

  const FrameFormat& format() const override { return format_; }
  std::string description() const override { return "stream " + stream_.path(); }
  std::vector<std::string> notes() const override {
    if (!floats_) return {};
    std::ostringstream text;
    text << "float pixels are read as ADU = " << format_.zero_adu << " + " << format_.scale_adu
         << " * count, count 0 to 65535, by the image that was in the stream when it was opened";
    return {text.str()};
  }

  void start(FrameExchange& exchange) override {
    stop();
    stopping_ = false;
    set_failure("");
    semaphore_ = claim_semaphore();
    while (sem_trywait(&stream_.semaphores()[semaphore_]) == 0) {
    }  // Posts of updates before this start.
    seen_ = updates();
    numbering_.restart();
    thread_ = std::thread([this, &exchange] { receive(exchange); });
  }

  void stop() noexcept override {
    stopping_ = true;
    if (!thread_.joinable()) return;
    thread_.join();
    std::atomic_ref(stream_.read_pids()[semaphore_]).store(-1, std::memory_order_release);
  }

  std::string failure() const override {
    const std::lock_guard lock(mutex_);
    return failure_;
  }

  FrameCounts counts() const override {
    FrameCounts counts;
    counts.delivered = delivered_.load(std::memory_order_relaxed);
    counts.lost = lost_.load(std::memory_order_relaxed);
    counts.no_buffer = no_buffer_.load(std::memory_order_relaxed);
    return counts;
  }

 private:
  /// Takes a semaphore that no living process reads.
  std::size_t claim_semaphore() const {
    const auto pids = stream_.read_pids();
    for (std::size_t i = 0; i < pids.size(); ++i) {
      std::atomic_ref pid(pids[i]);
      std::int32_t owner = pid.load(std::memory_order_acquire);
      const bool taken = owner > 0 && (kill(owner, 0) == 0 || errno != ESRCH);
      if (!taken && pid.compare_exchange_strong(owner, getpid())) return i;
    }
    throw Failure("stream " + stream_.path() + " has no free semaphore; stop one of its " +
                  std::to_string(pids.size()) + " readers");
  }

  void set_failure(const std::string& why) {
    const std::lock_guard lock(mutex_);
    failure_ = why;
  }

  /// Waits for the writer, a twentieth of a second at most. Returns whether it has posted.
  bool wait() const noexcept {
    constexpr long kWaitNs = 50'000'000;
    timespec until{};
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_nsec += kWaitNs;
    if (until.tv_nsec >= kNsPerS) {
      ++until.tv_sec;
      until.tv_nsec -= kNsPerS;
    }
    sem_t& semaphore = stream_.semaphores()[semaphore_];
    if (sem_clockwait(&semaphore, CLOCK_MONOTONIC, &until) != 0) return false;
    while (sem_trywait(&semaphore) == 0) {
    }  // Older posts are of frames that are gone.
    return true;
  }

  std::uint64_t updates() const noexcept {
    return std::atomic_ref(stream_.metadata().cnt0).load(std::memory_order_acquire);
  }
  bool changing() const noexcept {
    return std::atomic_ref(stream_.metadata().write).load(std::memory_order_acquire) != 0;
  }

  void copy_pixels(FrameBuffer& into) const noexcept {
    if (!floats_) {
      std::memcpy(into.data(), stream_.data(), format_.bytes());
      return;
    }
    const auto* from = reinterpret_cast<const float*>(stream_.data());
    auto* counts = reinterpret_cast<std::uint16_t*>(into.data());
    const double per_adu = 1.0 / format_.scale_adu;
    for (std::size_t i = 0; i < format_.pixels(); ++i) {
      const double count = (static_cast<double>(from[i]) - format_.zero_adu) * per_adu;
      // Written so that what is not a number becomes 0.
      counts[i] =
          count > 0.0 ? static_cast<std::uint16_t>(std::lround(std::min(count, kMostCounts))) : 0;
    }
  }

  /// Copies the image of update number `number`. Returns false if it changed meanwhile: its number
  /// is then missing, and so it counts as lost.
  bool copy(std::uint64_t number, FrameBuffer& into) const noexcept {
    if (changing()) return false;
    const StreamMetadata& metadata = stream_.metadata();
    into.header.camera_ns = ns_of(metadata.atime);
    copy_pixels(into);
    std::atomic_thread_fence(std::memory_order_acquire);
    return updates() == number && !changing();
  }

  void receive(FrameExchange& exchange) {
    if (thread_start_) thread_start_();
    FrameBuffer* buffer = nullptr;
    while (!stopping_) {
      // There are writers that post no semaphore. Their counter is looked at all the same.
      if (!wait() && updates() == seen_) {
        if (stream_.is_current()) continue;
        set_failure("stream " + stream_.path() + " was made anew or removed by its writer");
        break;
      }
      const auto received = std::chrono::steady_clock::now();
      const std::uint64_t number = updates();
      if (number == seen_) continue;
      if (buffer == nullptr) buffer = exchange.empty();
      if (buffer == nullptr) {
        no_buffer_.fetch_add(1, std::memory_order_relaxed);  // Its number will be missing.
        seen_ = number;
        continue;
      }
      if (!copy(number, *buffer)) continue;
      seen_ = number;
      const FrameNumbering::Arrival arrival = numbering_.numbered(number);
      lost_.fetch_add(arrival.lost, std::memory_order_relaxed);
      FrameHeader& header = buffer->header;
      header.sequence = arrival.sequence;
      header.renumbered = arrival.renumbered;
      header.received_ns = utc_now_ns();
      header.received = received;
      header.status = arrival.lost > 0 ? kFrameGapBefore : kFrameOk;
      buffer->rows_ready = format_.rows;
      delivered_.fetch_add(1, std::memory_order_relaxed);
      buffer = exchange.deliver(buffer);
    }
    if (buffer != nullptr) exchange.put_back(buffer);
    exchange.close();
  }

  MappedStream stream_;
  ThreadStart thread_start_;
  FrameFormat format_;
  bool floats_;
  std::size_t semaphore_ = 0;
  std::uint64_t seen_ = 0;  ///< the last update that was taken or given up
  FrameNumbering numbering_{false};
  std::thread thread_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::int64_t> delivered_{0};
  std::atomic<std::int64_t> lost_{0};
  std::atomic<std::int64_t> no_buffer_{0};
  mutable std::mutex mutex_;
  std::string failure_;
};

}  // namespace

std::unique_ptr<Camera> open_stream_camera(const std::string& name,
                                           const ThreadStart& thread_start) {
  const std::string path =
      name.find('/') != std::string::npos ? name : stream_folder() + "/" + name + ".im.shm";
  return std::make_unique<StreamCamera>(MappedStream::open(path), thread_start);
}

}  // namespace curlew
