#include "service/daemon/frame_snapshot.h"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>
#include <utility>

#include "core/error.h"
#include "service/results/results_file.h"

namespace curlew {
namespace {

/// A folder that nobody else can look into, as long as this object lives.
class PrivateFolder {
 public:
  PrivateFolder() {
    std::error_code none;
    path_ = std::filesystem::temp_directory_path(none) / "curlew-snapshot.XXXXXX";
    if (none || mkdtemp(path_.data()) == nullptr)
      throw Failure("a snapshot needs a temporary folder, and none can be made in " +
                    std::filesystem::path(path_).parent_path().string() +
                    "; TMPDIR in the environment names another");
  }
  ~PrivateFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace

FrameSnapshot::FrameSnapshot(std::shared_ptr<const Plan> plan, const FrameFormat& format)
    : plan_(std::move(plan)), frame_(format), slot_(*plan_) {
  slot_.frame = &frame_;
}

void FrameSnapshot::copy(const FrameSlot& slot) noexcept {
  slot_.frame_index = slot.frame_index;
  frame_.header = slot.frame->header;
  std::memcpy(frame_.data(), slot.frame->view().pixels, frame_.format().bytes());
  slot_.centroids = slot.centroids;
  slot_.slopes = slot.slopes;
  slot_.circulation = slot.circulation;
  slot_.vortices.assign(slot.vortices);
  slot_.split = slot.split;
  slot_.whole_phase = slot.whole_phase;
  slot_.latency = slot.latency;
}

std::string FrameSnapshot::file() const {
  const PrivateFolder folder;
  const std::string path = folder.path() + "/snapshot.fits";
  SaveOptions all;
  all.slopes = all.flux = all.phase = all.solenoidal = all.circulation = all.zernike = true;
  all.frame = true;
  all.whole_phase = plan_->hidden_phase.has_value();
  ResultsFile results(path, *plan_, all, 1);
  results.add(slot_);
  results.add_latency(slot_);
  results.commit();
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return std::move(bytes).str();
}

bool SnapshotExchange::wait(FrameSnapshot& snapshot, std::chrono::milliseconds patience) {
  using namespace std::chrono_literals;
  const auto end = std::chrono::steady_clock::now() + patience;
  wanted_.store(&snapshot, std::memory_order_release);
  while (wanted_.load(std::memory_order_acquire) != nullptr &&
         std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(1ms);
  const bool still_wanted = wanted_.exchange(nullptr) != nullptr;
  while (filling_.load()) std::this_thread::sleep_for(1ms);
  return !still_wanted;
}

void SnapshotExchange::fill(FrameSnapshot& wanted, const FrameSlot& slot) noexcept {
  // From here on the waiting thread leaves the snapshot alone, if it is still wanted.
  filling_.store(true);
  FrameSnapshot* expected = &wanted;
  if (wanted_.load() == &wanted && wanted.fits(slot)) {
    wanted.copy(slot);
    wanted_.compare_exchange_strong(expected, nullptr);
  }
  filling_.store(false, std::memory_order_release);
}

}  // namespace curlew
