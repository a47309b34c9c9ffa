#include "service/page/frame_store.h"

#include <nlohmann/json.hpp>

#include "service/page/latency_summary.h"

namespace curlew {

FrameStore::FrameStore(std::shared_ptr<const Plan> plan, const std::string& title,
                       std::size_t most_frames, std::size_t most_bytes)
    : most_frames_(most_frames),
      most_bytes_(most_bytes),
      plan_(std::move(plan), 1, title),
      description_(plan_.description()) {}

void FrameStore::add(const FrameSlot& slot, std::int64_t dropped) {
  PageMessage message;
  std::string point;
  if (slot.frame_index % every_ == 0) {
    if (!copy_.copy(slot, dropped)) {
      copy_.fit();
      copy_.copy(slot, dropped);
    }
    message = plan_.frame(copy_, "");
    point = plan_.point(copy_);
  }
  const std::lock_guard lock(mutex_);
  latencies_.push_back(slot.latency);
  if (!message) return;
  bytes_ += message->size();
  frames_.push_back(std::move(message));
  points_.push_back(std::move(point));
  while (frames_.size() > 1 && (frames_.size() > most_frames_ || bytes_ > most_bytes_)) thin_out();
}

void FrameStore::thin_out() {
  every_ *= 2;
  bytes_ = 0;
  for (std::size_t i = 0; 2 * i < frames_.size(); ++i) {
    if (i > 0) frames_[i] = std::move(frames_[2 * i]);
    if (i > 0) points_[i] = std::move(points_[2 * i]);
    bytes_ += frames_[i]->size();
  }
  frames_.resize((frames_.size() + 1) / 2);
  points_.resize(frames_.size());
}

void FrameStore::finish() {
  const std::lock_guard lock(mutex_);
  finished_ = true;
}

std::string FrameStore::status() {
  const std::lock_guard lock(mutex_);
  const nlohmann::ordered_json json{
      {"mode", "replay"},      {"frames", frames_.size()},
      {"every", every_},       {"all_frames", latencies_.size()},
      {"finished", finished_}, {"latency", latency_summary(latencies_)}};
  std::string text = json.dump();
  if (!finished_) return text;
  text.pop_back();
  text += R"(,"points":[)";
  for (std::size_t i = 0; i < points_.size(); ++i)
    text.append(i == 0 ? "" : ",").append(points_[i]);
  return text + "]}";
}

PageMessage FrameStore::sensor(std::int64_t plan) {
  return plan == plan_.number() ? description_ : nullptr;
}

PageMessage FrameStore::frame(std::int64_t number, std::chrono::milliseconds) {
  const std::lock_guard lock(mutex_);
  if (number < 0 || number >= static_cast<std::int64_t>(frames_.size())) return nullptr;
  return frames_[static_cast<std::size_t>(number)];
}

}  // namespace curlew
