#include "service/page/live_page.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "service/page/latency_summary.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kLongestWait{1000};
constexpr std::size_t kPlans = 3;  // The one in use, the one before, and one that is taken up.

}  // namespace

void LivePage::know(std::shared_ptr<const Plan> plan) {
  auto described = std::make_shared<PagePlan>(std::move(plan), 0, title_);
  const std::lock_guard lock(mutex_);
  described->number(++plans_known_);
  plans_.push_back(std::move(described));
  if (plans_.size() > kPlans) plans_.erase(plans_.begin());
}

std::string LivePage::status() {
  return R"({"mode":"live","settings":)" + nlohmann::json(settings_).dump() + R"(,"status":)" +
         status_of_() + "}";
}

PageMessage LivePage::sensor(std::int64_t plan) {
  const std::lock_guard lock(mutex_);
  for (const auto& known : plans_)
    if (known->number() == plan) return known->description();
  return nullptr;
}

std::shared_ptr<PagePlan> LivePage::plan_of(const Plan* plan) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find_if(plans_, [&](const auto& p) { return p->plan() == plan; });
  return found == plans_.end() ? nullptr : *found;
}

/// Takes over the frame that has passed, and asks for the next when its time has come.
void LivePage::look() {
  if (asked_) {
    const FrameCopy* copy = tap_.answer();
    if (copy == nullptr) return;
    asked_ = false;
    const auto plan = plan_of(copy->plan);
    if (!plan) return;
    newest_ = plan->frame(*copy, R"(,"number":)" + std::to_string(++newest_number_) +
                                     R"(,"status":)" + status_of_() + R"(,"latency":)" +
                                     latency_summary(tap_.latencies()).dump());
    shown_ = Clock::now();
  } else if (Clock::now() - shown_ >= kBetweenFrames) {
    tap_.ask();
    asked_ = true;
  }
}

PageMessage LivePage::frame(std::int64_t number, milliseconds waited) {
  look();
  const bool fresh = Clock::now() - shown_ < kLongestWait;
  if (newest_ && newest_number_ != number && fresh) return newest_;
  if (waited < kLongestWait) return nullptr;
  return plain_message(R"({"kind":"status","status":)" + status_of_() + "}");
}

}  // namespace curlew
