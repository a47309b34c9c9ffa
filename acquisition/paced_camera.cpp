#include "acquisition/paced_camera.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <mutex>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "acquisition/drawn_loop.h"
#include "acquisition/recording/fits_source.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "core/readout.h"
#include "core/utc_now.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kDefaultRateHz = 1000.0;
constexpr std::int64_t kFramesDrawn = 100;
constexpr double kDrawnExposure_us = 1000.0;  // of simulated frames
constexpr double kLeastExposure_us = 1.0;
constexpr double kLongestExposure_us = 1e6;

Clock::duration duration_of(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// Returns the pace with its rate, which must leave time for the readout.
Pace checked(Pace pace) {
  if (!(pace.rate_hz > 0.0)) pace.rate_hz = kDefaultRateHz;
  if (pace.readout_us * 1e-6 * pace.rate_hz > 1.0) {
    throw UsageError(
        "camera.readout_us is longer than the time between two frames; lower it, or "
        "camera.frame_rate_hz");
  }
  return pace;
}

class PacedCamera final : public Camera {
 public:
  PacedCamera(std::unique_ptr<FrameSource> source, const Pace& pace, PacedCameraNature nature,
              ThreadStart thread_start)
      : source_(std::move(source)),
        period_(duration_of(1.0 / pace.rate_hz)),
        readout_(duration_of(pace.readout_us * 1e-6)),
        nature_(std::move(nature)),
        exposure_us_(nature_.exposure_us),
        thread_start_(std::move(thread_start)),
        scratch_(source_->format()) {}
  ~PacedCamera() override { stop(); }
  PacedCamera(const PacedCamera&) = delete;
  PacedCamera& operator=(const PacedCamera&) = delete;

  const FrameFormat& format() const override { return source_->format(); }
  std::string description() const override { return nature_.description; }
  Optics optics() const override { return nature_.optics; }
  Detector detector() const override { return nature_.detector; }
  std::vector<std::string> notes() const override { return {}; }

  void start(FrameExchange& exchange) override {
    stop();
    stopping_ = false;
    failure_.clear();
    thread_ = std::thread([this, &exchange] { send(exchange); });
  }

  void stop() noexcept override {
    stopping_ = true;
    if (thread_.joinable()) thread_.join();
  }

  double exposure_us() override { return exposure_us_; }
  double set_exposure_us(double exposure_us) override {
    if (nature_.exposure_us <= 0.0) return Camera::set_exposure_us(exposure_us);
    exposure_us_ = std::clamp(exposure_us, kLeastExposure_us, kLongestExposure_us);
    return exposure_us_;
  }

  std::string failure() const override {
    const std::lock_guard lock(mutex_);
    return failure_;
  }

  FrameCounts counts() const override {
    FrameCounts counts;
    counts.delivered = delivered_.load(std::memory_order_relaxed);
    counts.aborted = aborted_.load(std::memory_order_relaxed);
    counts.lost = counts.no_buffer = lost_.load(std::memory_order_relaxed);
    return counts;
  }

 private:
  /// Waits until `due`, or until the camera is stopped.
  void wait_until(Clock::time_point due) const {
    constexpr auto kLookUp = std::chrono::milliseconds(50);
    while (!stopping_ && Clock::now() < due)
      std::this_thread::sleep_until(std::min(due, Clock::now() + kLookUp));
  }

  /// Does the same without being late by the time that a wake-up takes.
  void wait_closely_until(Clock::time_point due) const {
    constexpr auto kWakeUp = std::chrono::microseconds(100);
    wait_until(due - kWakeUp);
    while (!stopping_ && Clock::now() < due) std::this_thread::yield();
  }

  static void stamp(FrameHeader& header) {
    header.received_ns = utc_now_ns();
    header.received = Clock::now();
  }

  /// Makes the frame what it is at the exposure of now.
  void expose(FrameBuffer& frame) const {
    const double exposure_us = exposure_us_;
    if (exposure_us == nature_.exposure_us) return;
    const double factor = exposure_us / nature_.exposure_us;
    const double bias = nature_.bias_adu;
    const double most = nature_.detector.saturation_adu;
    const auto scale = [&](auto* pixels) {
      for (std::size_t i = 0; i < frame.format().pixels(); ++i)
        pixels[i] = static_cast<std::remove_reference_t<decltype(*pixels)>>(std::clamp(
            std::round(bias + factor * (static_cast<double>(pixels[i]) - bias)), 0.0, most));
    };
    if (frame.format().pixel_type == PixelType::kU16)
      scale(reinterpret_cast<std::uint16_t*>(frame.data()));
    else
      scale(reinterpret_cast<std::uint8_t*>(frame.data()));
  }

  /// Hands the frame on with its first rows, and copies each row of scratch_ when it is due.
  /// Returns a buffer to fill, or nullptr.
  FrameBuffer* read_out(FrameExchange& exchange, FrameBuffer& frame) {
    constexpr int kRowsAtOnce = 4;
    const int rows = frame.format().rows;
    const std::size_t row_bytes = frame.format().bytes() / static_cast<std::size_t>(rows);
    const auto start = Clock::now();
    FrameBuffer* superseded = nullptr;
    int done = 0;
    while (done < rows) {
      const int next = std::min(done + kRowsAtOnce, rows);
      wait_closely_until(start + readout_ * next / rows);
      if (stopping_) break;
      const std::size_t first_byte = static_cast<std::size_t>(done) * row_bytes;
      std::copy_n(scratch_.data() + first_byte, static_cast<std::size_t>(next - done) * row_bytes,
                  frame.data() + first_byte);
      if (next == rows) {
        stamp(frame.header);
        delivered_.fetch_add(1, std::memory_order_relaxed);
        exchange.count_delivered();
      }
      announce_rows(frame, next);
      if (done == 0) superseded = exchange.hand_on(&frame);
      done = next;
    }
    if (done == rows) return superseded;
    aborted_.fetch_add(1, std::memory_order_relaxed);
    if (done == 0) return &frame;  // Nobody has seen it.
    break_off(frame);
    if (!exchange.take_back(&frame)) return superseded;
    if (superseded != nullptr) exchange.put_back(superseded);
    return &frame;
  }

  void send(FrameExchange& exchange) {
    if (thread_start_) thread_start_();
    try {
      Clock::time_point due = Clock::now();
      FrameBuffer* buffer = exchange.empty();
      bool first = true;
      bool gap = false;
      while (!stopping_) {
        if (buffer == nullptr) buffer = exchange.empty();
        const bool rolling = readout_ > Clock::duration::zero();
        FrameBuffer& into = buffer != nullptr && !rolling ? *buffer : scratch_;
        if (source_->next(into) == Delivery::kEnd) break;
        expose(into);
        wait_until(due);
        // If the rate cannot be kept, frames that are late are not caught up with in a burst.
        due = std::max(due + period_, Clock::now() - period_);
        const std::int64_t sequence = next_sequence_++;
        if (buffer == nullptr) {
          lost_.fetch_add(1, std::memory_order_relaxed);
          gap = true;
          continue;
        }
        FrameHeader& header = buffer->header;
        header = into.header;
        header.sequence = sequence;
        header.renumbered = std::exchange(first, false);
        header.status = std::exchange(gap, false) ? kFrameGapBefore : kFrameOk;
        if (rolling) {
          buffer = read_out(exchange, *buffer);
        } else {
          stamp(header);
          delivered_.fetch_add(1, std::memory_order_relaxed);
          buffer = exchange.deliver(buffer);
        }
      }
    } catch (const std::exception& error) {
      const std::lock_guard lock(mutex_);
      failure_ = error.what();
    }
    exchange.close();
  }

  std::unique_ptr<FrameSource> source_;
  Clock::duration period_;
  Clock::duration readout_;  ///< of a frame; 0 if it comes whole
  PacedCameraNature nature_;
  std::atomic<double> exposure_us_;
  ThreadStart thread_start_;
  /// Takes the frames for which there is no buffer, and those that are read out row by row.
  FrameBuffer scratch_;
  std::thread thread_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::int64_t> delivered_{0};
  std::atomic<std::int64_t> aborted_{0};
  std::atomic<std::int64_t> lost_{0};
  std::int64_t next_sequence_ = 0;
  mutable std::mutex mutex_;
  std::string failure_;
};

}  // namespace

std::unique_ptr<Camera> make_paced_camera(std::unique_ptr<FrameSource> source, const Pace& pace,
                                          PacedCameraNature nature, ThreadStart thread_start) {
  return std::make_unique<PacedCamera>(std::move(source), checked(pace), std::move(nature),
                                       std::move(thread_start));
}

std::unique_ptr<Camera> open_file_camera(const std::string& path, const Pace& pace,
                                         const ThreadStart& thread_start) {
  auto source = std::make_unique<FitsSource>(std::vector<std::string>{path});
  PacedCameraNature nature{"recording " + path, source->optics(), source->detector()};
  return make_paced_camera(std::move(source), pace, std::move(nature), thread_start);
}

SimulatorOptions simulated_camera_options(const std::string& preset) {
  SimulatorOptions options;
  options.frames = -1;
  add_preset(preset, {}, options);
  return options;
}

std::unique_ptr<Camera> open_simulated_camera(const std::string& preset, const Pace& pace,
                                              const ThreadStart& thread_start) {
  const SimulatorOptions options = simulated_camera_options(preset);
  auto simulator = std::make_unique<Simulator>(options);
  PacedCameraNature nature{"simulated camera, preset " + preset, simulator->optics(),
                           simulator->detector(), kDrawnExposure_us, options.bias_adu};
  // Frames behind turbulence take a third of a second each, and the others a few milliseconds.
  const std::int64_t drawn_first = options.turbulence ? 1 : kFramesDrawn;
  auto loop = std::make_unique<DrawnLoop>(
      std::move(simulator), DrawnLoop::Plan{.frames = kFramesDrawn,
                                            .drawn_first = drawn_first,
                                            .interval_ns = Simulator::kFramePeriodNs});
  return make_paced_camera(std::move(loop), pace, std::move(nature), thread_start);
}

}  // namespace curlew
