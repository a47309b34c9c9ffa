#include "service/recorder/recorder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

#include "core/error.h"
#include "core/polite_thread.h"
#include "service/recorder/recorder_files.h"

namespace curlew {
namespace {

using std::chrono::steady_clock;

constexpr std::int64_t kWaitTime_us = 100'000;
constexpr std::size_t kMinItems = 4;

// Refuses a memory_mb that the machine has not got, before any of it is taken.
void check_memory(int memory_mb) {
  const std::int64_t machine_mb = sysconf(_SC_PHYS_PAGES) * (sysconf(_SC_PAGESIZE) / 1024) / 1000;
  if (memory_mb <= machine_mb / 2) return;
  throw UsageError(fmt::format(
      "recorder.memory_mb = {} asks for {} MB of memory, and this machine has {} MB: set at most "
      "half of that",
      memory_mb, memory_mb, machine_mb));
}

std::size_t item_count(const RecorderOptions& options, const FrameFormat& format) {
  const std::size_t bytes = static_cast<std::size_t>(options.memory_mb) * 1'000'000;
  return std::max(kMinItems, bytes / std::max<std::size_t>(1, format.bytes()));
}

steady_clock::duration seconds(double s) {
  return std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(s));
}

}  // namespace

struct Recorder::Item {
  explicit Item(const FrameFormat& format) : frame(format) {}
  FrameBuffer frame;
  bool is_asked = false;         ///< Somebody asked for this trigger.
  std::optional<Vortex> vortex;  ///< This vortex is a trigger.

  bool is_trigger() const { return is_asked || vortex; }
  /// Says what triggered.
  std::string cause() const {
    if (is_asked || !vortex) return "the trigger was asked for";
    std::string text = fmt::format("the trigger is a vortex of charge {:+} at ({:.2f}, {:.2f})",
                                   vortex->charge, vortex->x, vortex->y);
    if (vortex->probability != kUnknownProbability)
      text += fmt::format(", probability {:.3f}", vortex->probability);
    if (vortex->track >= 0) text += fmt::format(", track {}", vortex->track);
    return text;
  }
};

/// The recorder's thread runs this: it takes the items, and writes them or keeps them for a
/// trigger.
class Recorder::Writer {
 public:
  Writer(SideQueue<Item>& queue, const RecorderOptions& options, const FrameFormat& format,
         const RecordingHeader& header, const std::function<void(const std::string&)>& log)
      : queue_(queue),
        options_(options),
        before_(seconds(options.before_s)),
        after_(seconds(options.after_s)),
        max_kept_(queue.items() - std::max<std::size_t>(2, queue.items() / 8)),
        log_(log),
        files_(options, format, header, log) {}

  void run() {
    become_polite("recorder");
    Item* item = nullptr;
    while (true) {
      const bool is_taken = queue_.take_for(item, kWaitTime_us);
      if (has_header_.exchange(false)) describe_files();
      if (is_taken) {
        handle(item);
      } else if (queue_.ended()) {
        break;
      }
      files_.commit_if_due();
    }
    files_.end_file();
  }

  RecorderCounts counts() const { return files_.counts(); }

  void describe(const RecordingHeader& header) {
    const std::lock_guard lock(header_mutex_);
    header_ = header;
    has_header_ = true;
  }

 private:
  void describe_files() {
    const std::lock_guard lock(header_mutex_);
    files_.describe(header_);
  }

  void handle(Item* item) {
    if (options_.mode == RecordMode::kContinuous) {
      write(item);
      return;
    }
    const auto time = item->frame.header.received;
    const bool recording = time <= until_;
    if (!recording) files_.end_file();
    if (!recording && !item->is_trigger()) {
      keep(item);
      return;
    }
    if (item->is_trigger()) {
      if (!recording) log_(item->cause());
      until_ = time + after_;
      forget_before(time - before_);
      for (Item* kept : kept_) write(kept);
      kept_.clear();
    }
    write(item);
  }

  void write(Item* item) {
    files_.write(item->frame);
    queue_.give_back(item);
  }

  void keep(Item* item) {
    const auto time = item->frame.header.received;
    kept_.push_back(item);
    forget_before(time - before_);
    if (kept_.size() <= max_kept_) return;
    forget_oldest();
    if (std::exchange(has_told_of_memory_, true)) return;
    const std::chrono::duration<double> held = time - kept_.front()->frame.header.received;
    log_(
        fmt::format("recorder.memory_mb = {} holds {:.1f} s of the {:.1f} s before a trigger that "
                    "recorder.before_s asks for",
                    options_.memory_mb, held.count(), options_.before_s));
  }

  void forget_before(steady_clock::time_point time) {
    while (!kept_.empty() && kept_.front()->frame.header.received < time) forget_oldest();
  }

  void forget_oldest() {
    queue_.give_back(kept_.front());
    kept_.pop_front();
  }

  SideQueue<Item>& queue_;
  RecorderOptions options_;
  steady_clock::duration before_;
  steady_clock::duration after_;
  std::size_t max_kept_;  ///< It is less than all items, so that some are free for new frames.
  std::function<void(const std::string&)> log_;
  RecorderFiles files_;
  std::mutex header_mutex_;
  RecordingHeader header_;
  std::atomic<bool> has_header_{false};
  std::deque<Item*> kept_;  ///< These are the last frames before a trigger, oldest first.
  steady_clock::time_point until_ = steady_clock::time_point::min();  ///< The event ends then.
  bool has_told_of_memory_ = false;
};

Recorder::Recorder(const RecorderOptions& options, const FrameFormat& format,
                   const RecordingHeader& header, std::function<void(const std::string&)> log)
    : options_(options) {
  if (options.mode == RecordMode::kOff) return;
  check_memory(options.memory_mb);
  queue_ = std::make_unique<SideQueue<Item>>(item_count(options, format),
                                             [&] { return std::make_unique<Item>(format); });
  // The recorder's thread and the compressor's thread both log.
  const auto mutex = std::make_shared<std::mutex>();
  writer_ = std::make_unique<Writer>(*queue_, options, format, header,
                                     [mutex, log = std::move(log)](const std::string& sentence) {
                                       const std::lock_guard lock(*mutex);
                                       log(sentence);
                                     });
  thread_ = std::thread([this] { writer_->run(); });
}

Recorder::~Recorder() { finish(); }

RecorderCounts Recorder::finish() {
  if (thread_.joinable()) {
    queue_->close();
    thread_.join();
  }
  return counts();
}

/// Returns the first vortex that is a trigger; null where none is.
const Vortex* Recorder::triggering(const VortexList& vortices) const noexcept {
  if (options_.mode != RecordMode::kTrigger || !options_.trigger_on_vortex) return nullptr;
  const auto is_trigger = [&](const Vortex& vortex) {
    return (!options_.trigger_tracked_only || vortex.track >= 0) &&
           (options_.trigger_min_probability <= 0.0 ||
            static_cast<double>(vortex.probability) >= options_.trigger_min_probability);
  };
  const auto* const found = std::find_if(vortices.begin(), vortices.end(), is_trigger);
  return found != vortices.end() ? &*found : nullptr;
}

void Recorder::describe(const RecordingHeader& header) {
  if (writer_) writer_->describe(header);
}

void Recorder::add(const FrameBuffer& frame, const VortexList* vortices) noexcept {
  if (!queue_) return;
  Item* item = queue_->claim();
  if (item == nullptr) return;
  std::memcpy(item->frame.data(), frame.view().pixels, frame.format().bytes());
  item->frame.header = frame.header;
  item->is_asked = triggered_.load(std::memory_order_relaxed) &&
                   triggered_.exchange(false, std::memory_order_relaxed);
  const Vortex* const vortex = vortices != nullptr ? triggering(*vortices) : nullptr;
  item->vortex = vortex != nullptr ? std::optional(*vortex) : std::nullopt;
  queue_->send(item);
}

void Recorder::trigger() noexcept { triggered_.store(true, std::memory_order_relaxed); }

RecorderCounts Recorder::counts() const {
  if (!queue_) return {};
  RecorderCounts counts = writer_->counts();
  counts.dropped += queue_->dropped();
  return counts;
}

}  // namespace curlew
