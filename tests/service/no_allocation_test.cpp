// The frame path allocates nothing: every malloc of the process is counted while frames run.
#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>

#include "acquisition/simulator.h"
#include "service/pipeline.h"
#include "tests/support/simulated_sensor.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define CURLEW_COUNTS_ALLOCATIONS 0
#else
#define CURLEW_COUNTS_ALLOCATIONS 1
#endif

namespace {
std::atomic<bool> counting{false};
std::atomic<long> allocations{0};
}  // namespace

#if CURLEW_COUNTS_ALLOCATIONS
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

static void count() {
  if (counting.load(std::memory_order_relaxed)) ++allocations;
}
void* malloc(std::size_t size) {
  count();
  return __libc_malloc(size);
}
void* calloc(std::size_t n, std::size_t size) {
  count();
  return __libc_calloc(n, size);
}
void* realloc(void* old, std::size_t size) {
  count();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  count();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? 12 : 0;
}
}
#endif

namespace curlew {
namespace {

constexpr int kWindow = 8;

/// A pupil with a hole, vortices, lenslets that fade in some frames.
SimulatorOptions busy_scene() {
  SimulatorOptions options;
  options.rows = options.cols = 12;
  options.window_px = kWindow;
  options.pupil = PupilShape::kObscured;
  options.photons = 150.0;
  options.scene.core_radius = 1.5;
  options.frames = -1;
  options.scene.vortices = {{3.2, 4.6, 1}, {8.1, 6.7, -1}};
  options.scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  return options;
}

TEST(NoAllocation, TheCounterCounts) {
  if (CURLEW_COUNTS_ALLOCATIONS == 0) GTEST_SKIP() << "the sanitizer owns malloc";
  allocations = 0;
  counting = true;
  void* volatile seen = ::operator new(3);  // volatile: the compiler must not take the pair out
  ::operator delete(seen);
  seen = ::operator new (64, std::align_val_t{64});
  ::operator delete (seen, std::align_val_t{64});
  counting = false;
  EXPECT_EQ(allocations, 2);
}

class NoAllocationModes : public ::testing::TestWithParam<std::tuple<Threading, bool>> {};

TEST_P(NoAllocationModes, AThousandFrames) {
  if (CURLEW_COUNTS_ALLOCATIONS == 0) GTEST_SKIP() << "the sanitizer owns malloc";
  const auto [threads, weighted] = GetParam();
  Simulator simulator(busy_scene());
  const Sensor sensor = sensor_of(simulator, kWindow, 100.0);
  Config config;
  config.split.weighted = weighted;
  config.pipeline.threads = threads;
  const auto plan = std::make_shared<const Plan>(sensor, simulator.format(), config);
  Pipeline pipeline(plan, config.pipeline);
  RecordedFeed feed(simulator, {0.0, 1100});
  int faded = 0;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    // The first frames let threads and queues settle; then a thousand are counted.
    if (slot.frame_index == 50) counting = true;
    if (slot.frame_index == 1050) counting = false;
    if (slot.slopes.n_valid < plan->split.lattice().n_lenslets()) ++faded;
  };
  allocations = 0;
  const RunReport report = pipeline.run(feed, publisher);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(faded, 100) << "frames with faded lenslets must be among those counted";
  EXPECT_GT(report.vortices, 0);
}

INSTANTIATE_TEST_SUITE_P(Modes, NoAllocationModes,
                         ::testing::Combine(::testing::Values(Threading::kInline,
                                                              Threading::kPerStage),
                                            ::testing::Bool()));

}  // namespace
}  // namespace curlew
