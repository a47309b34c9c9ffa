#include "service/commands/shown_frames.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <thread>
#include <utility>

#include "service/page/report.h"
#include "service/program/interrupt.h"

namespace curlew {

ShownFrames::ShownFrames(ShownFramesOptions options, const std::string& recording,
                         std::shared_ptr<const Plan> plan)
    : options_(std::move(options)) {
  constexpr std::size_t kMostFrames = 1000;
  constexpr std::size_t kMostBytes = 256'000'000;
  if (!options_.wanted()) return;
  store_ = std::make_unique<FrameStore>(std::move(plan), recording, kMostFrames, kMostBytes);
  if (options_.page.empty()) return;
  PageOptions page;
  page.listen = options_.page;
  server_ = std::make_unique<PageServer>(page, *store_);
  fmt::print("the page is at {}\n", server_->url());
  std::fflush(stdout);
}

void ShownFrames::finish() const {
  if (!store_) return;
  store_->finish();
  if (options_.report.empty()) return;
  write_report(options_.report, *store_);
  fmt::print("\n{}: the report, which any browser opens\n", options_.report);
}

void ShownFrames::wait() const {
  if (!server_) return;
  fmt::print("\nthe page at {} shows the frames; Ctrl-C ends it\n", server_->url());
  std::fflush(stdout);
  while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

}  // namespace curlew
