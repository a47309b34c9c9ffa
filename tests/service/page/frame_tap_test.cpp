// What the page is told of a frame is what its slot says; and frames that nobody asks for cost
// next to nothing.
#include "service/page/frame_tap.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "acquisition/simulator/simulator.h"
#include "service/page/frame_store.h"
#include "service/page/latency_summary.h"
#include "service/page/live_page.h"
#include "service/pipeline.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"

namespace curlew {
namespace {

constexpr int kTapWindow = 8;

SimulatorOptions scene(int frames) {
  SimulatorOptions options;
  options.rows = 10;
  options.cols = 12;
  options.window_px = kTapWindow;
  options.photons = 1000.0;
  options.frames = frames;
  options.scene.core_radius = 1.5;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  return options;
}

/// Frames of a scene through the pipeline.
struct Frames {
  explicit Frames(int frames)
      : simulator(scene(frames)),
        plan(std::make_shared<const Plan>(sensor_of(simulator, kTapWindow, 0.0), simulator.format(),
                                          Config{})) {}

  void run(const std::function<void(const FrameSlot&)>& see) {
    Pipeline pipeline(plan, plan->config.pipeline);
    RecordedFeed feed(simulator, {});
    Publisher publisher;
    publisher.finish = [&](const FrameSlot& slot, std::int64_t) { see(slot); };
    pipeline.run(feed, publisher);
  }

  Simulator simulator;
  std::shared_ptr<const Plan> plan;
};

/// Returns the JSON of a message and, by its name, the place of an array in it.
struct Opened {
  explicit Opened(const PageMessage& message) : bytes(*message) {
    std::uint32_t length = 0;
    std::memcpy(&length, bytes.data(), sizeof(length));
    json = nlohmann::json::parse(bytes.substr(4, length));
    at = 4 + length;
  }
  template <typename T>
  std::vector<T> array(const std::string& name) const {
    std::size_t from = at;
    for (const auto& entry : json["arrays"]) {
      const std::size_t size = entry["rows"].get<std::size_t>() * entry["cols"].get<std::size_t>();
      const std::string type = entry["type"];
      const std::size_t width = type == "u8" ? 1 : (type == "u16" ? 2 : 4);
      if (entry["name"] == name) {
        std::vector<T> values(size);
        EXPECT_EQ(width, sizeof(T));
        std::memcpy(values.data(), bytes.data() + from, size * sizeof(T));
        return values;
      }
      from += (size * width + 3) / 4 * 4;
    }
    ADD_FAILURE() << name;
    return {};
  }
  std::string bytes;
  nlohmann::json json;
  std::size_t at = 0;
};

template <typename T>
std::vector<T> values_of(const Image<T>& image) {
  return {image.begin(), image.end()};
}

TEST(FrameMessages, SayWhatTheSlotSays) {
  Frames frames(1);
  PagePlan page(frames.plan, 7, "here");
  int seen = 0;
  frames.run([&](const FrameSlot& slot) {
    FrameCopy copy;
    EXPECT_FALSE(copy.copy(slot, 3)) << "the sizes are not known yet";
    copy.fit();
    ASSERT_TRUE(copy.copy(slot, 3));
    const Opened message(page.frame(copy, ",\"tail\":1"));
    EXPECT_EQ(message.json["plan"], 7);
    EXPECT_EQ(message.json["tail"], 1);
    EXPECT_EQ(message.json["result"]["dropped"], 3);
    EXPECT_EQ(message.json["result"]["n_valid"], slot.slopes.n_valid);
    ASSERT_EQ(message.json["result"]["vortices"].size(), slot.vortices.size());
    EXPECT_EQ(message.json["result"]["vortices"][0]["x"].get<float>(), slot.vortices[0].x);
    EXPECT_EQ(message.array<float>("phase_rad"), values_of(slot.split.phase));
    EXPECT_EQ(message.array<float>("circulation_rad"), values_of(slot.circulation.value));
    EXPECT_EQ(message.array<std::uint8_t>("slope_valid"), values_of(slot.slopes.valid));
    const auto pixels = message.array<std::uint16_t>("pixels");
    EXPECT_EQ(std::memcmp(pixels.data(), slot.frame->view().pixels, 2 * pixels.size()), 0);
    ++seen;
  });
  EXPECT_EQ(seen, 1);
}

TEST(FrameTap, CopiesOnlyWhatIsAskedForAndNeverAllocates) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  Frames frames(40);
  FrameTap tap;
  std::vector<std::int64_t> shown;
  frames.run([&](const FrameSlot& slot) {
    if (slot.frame_index == 5 || slot.frame_index == 20) tap.ask();
    const long allocated = allocations_of_this_thread([&] { tap.pass(slot, 0); });
    EXPECT_EQ(allocated, 0) << slot.frame_index;
    if (slot.frame_index % 3 != 0) return;
    if (const FrameCopy* copy = tap.answer(); copy != nullptr)
      if (shown.empty() || shown.back() != copy->result.frame_index)
        shown.push_back(copy->result.frame_index);
  });
  EXPECT_EQ(shown, (std::vector<std::int64_t>{7, 20})) << "the first is asked for anew at frame 6";
  EXPECT_EQ(tap.latencies().size(), 40U);
}

TEST(LivePage, ShowsFramesToAViewerInAnotherThread) {
  Frames frames(400);
  LivePage page([] { return std::string("{\"state\":\"streaming\"}"); }, "test", {});
  page.know(frames.plan);
  std::atomic<bool> over{false};
  std::vector<std::int64_t> shown;
  std::thread viewer([&] {
    std::int64_t last = 0;
    while (!over) {
      const PageMessage message = page.frame(last, std::chrono::milliseconds(0));
      if (!message) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        continue;
      }
      const Opened opened(message);
      last = opened.json["number"];
      shown.push_back(opened.json["result"]["frame"]);
      EXPECT_EQ(opened.json["status"]["state"], "streaming");
      EXPECT_GT(opened.json["latency"]["frames"], 0);
    }
  });
  frames.run([&](const FrameSlot& slot) {
    page.pass(slot, 0);
    if (slot.frame_index % 4 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  over = true;
  viewer.join();
  EXPECT_GT(shown.size(), 1U);
  EXPECT_LT(shown.size(), 100U) << "thirty a second";
  EXPECT_TRUE(std::is_sorted(shown.begin(), shown.end()));
  const PageMessage silence = page.frame(0, std::chrono::milliseconds(1000));
  EXPECT_NE(silence, nullptr) << "a page without frames still learns the status";
  EXPECT_NE(page.sensor(1), nullptr);
  EXPECT_EQ(page.sensor(2), nullptr);
}

TEST(FrameStore, ThinsOutEvenly) {
  Frames frames(100);
  FrameStore store(frames.plan, "test", 16, 1 << 30);
  frames.run([&](const FrameSlot& slot) { store.add(slot, 0); });
  store.finish();
  const auto status = nlohmann::json::parse(store.status());
  EXPECT_EQ(status["every"], 8);
  EXPECT_EQ(status["frames"], 13);
  EXPECT_EQ(status["all_frames"], 100);
  EXPECT_EQ(status["latency"]["frames"], 100);
  for (int i = 0; i < 13; ++i) EXPECT_EQ(Opened(store.frame(i, {})).json["result"]["frame"], 8 * i);
  EXPECT_EQ(store.frame(13, {}), nullptr);
  ASSERT_EQ(status["points"].size(), 13U);
  for (std::size_t i = 0; i < 13; ++i) {
    const auto frame = Opened(store.frame(static_cast<std::int64_t>(i), {})).json;
    const auto& point = status["points"][i];
    EXPECT_EQ(point["frame"], frame["result"]["frame"]);
    EXPECT_EQ(point["vortices"], frame["result"]["vortices"].size());
    EXPECT_EQ(point["rms"], frame["figures"]["rms_rad"]);
    EXPECT_EQ(point["scintillation"], frame["figures"]["scintillation"]);
  }
}

TEST(LatencySummaries, AreOrderStatistics) {
  std::vector<FrameLatency> latencies(200);
  for (std::size_t i = 0; i < latencies.size(); ++i)
    latencies[i].total_ns = static_cast<std::int64_t>(1000 * (i + 1));
  const auto summary = latency_summary(latencies);
  const auto& total = summary["stages"].back();
  EXPECT_EQ(total["name"], "total");
  EXPECT_EQ(total["p50_us"], 100.0);
  EXPECT_EQ(total["p99_us"], 198.0);
  EXPECT_EQ(total["max_us"], 200.0);
  std::int64_t counted = 0;
  for (const std::int64_t count : summary["total"]["counts"]) counted += count;
  EXPECT_EQ(counted, 200);
  EXPECT_EQ(summary["total"]["counts"][0], 1) << "from 1 µs to 1.26 µs";
}

}  // namespace
}  // namespace curlew
