// What the streams say of a frame is what its slot says, and writing them allocates nothing.
#include "service/publish/stream_publisher.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "acquisition/isio/mapped_stream.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/pipeline.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/exact_sensor.h"
#include "tests/support/failure_text.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr int kStreamWindow = 8;
constexpr int kStreamRows = 10;
constexpr int kStreamCols = 12;

SimulatorOptions scene() {
  SimulatorOptions options;
  options.rows = kStreamRows;
  options.cols = kStreamCols;
  options.window_px = kStreamWindow;
  options.pupil = PupilShape::kObscured;
  options.photons = 250.0;  // some lenslets fade
  options.frames = 400;
  options.scene.core_radius = 1.5;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  return options;
}

/// Compares the open streams with slots.
class Reader {
 public:
  explicit Reader(const std::string& folder) : folder_(folder) {}

  template <typename T>
  const T* data(const std::string& name) {
    auto found = streams_.find(name);
    if (found == streams_.end())
      found = streams_.emplace(name, MappedStream::open(folder_ + "/t_" + name + ".im.shm")).first;
    return reinterpret_cast<const T*>(found->second.data());
  }
  std::int64_t count(const std::string& name) const {
    return streams_.at(name).keywords()[6].number;
  }

  void expect_slot(const FrameSlot& slot) {
    const SlopeField& s = slot.slopes;
    const float* slopes = data<float>("slopes");
    const float* mask = data<float>("mask");
    for (int r = 0; r < kStreamRows; ++r)
      for (int c = 0; c < kStreamCols; ++c) {
        const bool valid = s.valid(r, c) != 0;
        const auto left = static_cast<std::size_t>(r * 2 * kStreamCols + c);
        ASSERT_EQ(slopes[left], valid ? s.x(r, c) : 0.0F);
        ASSERT_EQ(slopes[left + kStreamCols], valid ? s.y(r, c) : 0.0F);
        ASSERT_EQ(mask[left], valid ? 1.0F : 0.0F);
        ASSERT_EQ(mask[left + kStreamCols], valid ? 1.0F : 0.0F);
        const auto k = static_cast<std::size_t>(r * kStreamCols + c);
        ASSERT_EQ(data<float>("phase")[k], valid ? slot.split.phase[k] : 0.0F);
        ASSERT_EQ(data<float>("whole_phase")[k], valid ? slot.whole_phase[k] : 0.0F);
        ASSERT_EQ(data<float>("flux")[k], slot.centroids.flux_adu[k]);
      }
    for (std::size_t k = 0; k < slot.circulation.value.size(); ++k)
      ASSERT_EQ(data<float>("circulation")[k],
                slot.circulation.valid[k] != 0 ? slot.circulation.value[k] : 0.0F);
    const double* row = data<double>("vortices");
    ASSERT_EQ(count("vortices"), static_cast<std::int64_t>(slot.vortices.size()));
    for (const Vortex& v : slot.vortices) {
      ASSERT_EQ(row[0], v.x);
      ASSERT_EQ(row[1], v.y);
      ASSERT_EQ(row[2], v.charge);
      ASSERT_EQ(row[12], static_cast<double>(v.track));
      row += 13;
    }
    ASSERT_EQ(row[0], 0.0) << "rows beyond the count must be cleared";
    ASSERT_TRUE(std::isfinite(data<float>("zernike")[0]));
    ASSERT_GE(count("zernike"), 20);
    const auto pixels = slot.frame->view();
    ASSERT_EQ(std::memcmp(data<std::byte>("frame"), pixels.pixels, slot.frame->format().bytes()),
              0);
    ASSERT_EQ(count("slopes"), s.n_valid);
  }

 private:
  std::string folder_;
  std::map<std::string, MappedStream> streams_;
};

class StreamPublisherTest : public ::testing::Test {
 protected:
  StreamPublisherTest()
      : simulator_(scene()), sensor_(sensor_of(simulator_, kStreamWindow, 100.0)) {
    config_.split.hidden_phase = true;
    config_.publish.prefix = "t_";
    config_.publish.folder = scratch_.path();
    for (int i = 0; i <= static_cast<int>(PublishedStream::kFrame); ++i)
      config_.publish.streams.push_back(static_cast<PublishedStream>(i));
  }
  std::shared_ptr<const Plan> plan() const {
    return std::make_shared<const Plan>(sensor_, simulator_.format(), config_);
  }

  ScratchDirectory scratch_;
  Simulator simulator_;
  Sensor sensor_;
  Config config_;
};

TEST_F(StreamPublisherTest, StreamsAreTheSlotsAndNothingIsAllocated) {
  const auto made = plan();
  StreamPublisher streams(config_.publish, *made, simulator_.format());
  Pipeline pipeline(made, config_.pipeline);
  RecordedFeed feed(simulator_, {});
  Reader reader(scratch_.path());
  std::set<int> lenslets;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    counting = true;
    streams.publish(slot);
    counting = false;
    if (slot.frame_index % 10 == 0) reader.expect_slot(slot);
    lenslets.insert(slot.slopes.n_valid);
  };
  allocations = 0;
  EXPECT_GT(pipeline.run(feed, publisher).vortices, 100);
  EXPECT_GT(lenslets.size(), 3U) << "lenslets must have faded";
  EXPECT_EQ(kCountsAllocations ? allocations.load() : 0, 0);
}

TEST_F(StreamPublisherTest, ASlotOfAnotherShapeIsLeftOut) {
  const auto made = plan();
  StreamPublisher streams(config_.publish, *made, simulator_.format());
  SimulatorOptions other = scene();
  other.rows = kStreamRows + 2;
  other.frames = 1;
  Simulator larger(other);
  Pipeline pipeline(std::make_shared<const Plan>(sensor_of(larger, kStreamWindow, 100.0),
                                                 larger.format(), config_),
                    config_.pipeline);
  RecordedFeed feed(larger, {});
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) { streams.publish(slot); };
  EXPECT_EQ(pipeline.run(feed, publisher).frames, 1);
  EXPECT_EQ(MappedStream::open(scratch_ / "t_slopes.im.shm").metadata().cnt0, 0U);
}

TEST_F(StreamPublisherTest, APrefixIsPartOfAFileName) {
  const auto made = plan();
  config_.publish.prefix = "../up";
  EXPECT_THROW(StreamPublisher(config_.publish, *made, simulator_.format()), UsageError);
}

}  // namespace
}  // namespace curlew
