// Whatever is asked of the operating system is either got or refused in one sentence.
#include "service/realtime/realtime.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <random>
#include <set>
#include <thread>

#include "service/realtime/cpu_list.h"
#include "tests/support/ordinary_user.h"

namespace curlew {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr rlim_t kEightMegabytes = rlim_t{8} << 20;

long kilobytes(const char* file, const std::string& name) {
  std::ifstream lines(file);
  for (std::string line; std::getline(lines, line);)
    if (line.rfind(name + ":", 0) == 0) return std::stol(line.substr(name.size() + 1));
  return -1;
}
long locked_kb() { return kilobytes("/proc/self/status", "VmLck"); }

/// Tells whether mlockall works; under a sanitizer it does nothing.
bool locking_works() {
  if (mlockall(MCL_CURRENT) != 0) return false;
  const bool locked = locked_kb() > 0;
  munlockall();
  return locked;
}

std::vector<int> own_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (pthread_getaffinity_np(pthread_self(), sizeof set, &set) == 0)
    for (std::size_t cpu = 0; cpu < CPU_SETSIZE; ++cpu)
      if (CPU_ISSET(cpu, &set)) cpus.push_back(static_cast<int>(cpu));
  return cpus;
}

RealtimeOptions memory_lock() {
  RealtimeOptions options;
  options.lock_memory = true;
  return options;
}
RealtimeOptions huge_pages() {
  RealtimeOptions options;
  options.huge_pages = true;
  return options;
}
RealtimeOptions longest_wakeup(int wakeup_us) {
  RealtimeOptions options;
  options.max_cpu_wakeup_us = wakeup_us;
  return options;
}

struct Scheduling {
  int policy = -1;
  int priority = -1;
};
Scheduling own_scheduling() {
  Scheduling own;
  sched_param parameters{};
  pthread_getschedparam(pthread_self(), &own.policy, &parameters);
  own.priority = parameters.sched_priority;
  return own;
}

/// Runs on a thread that ends, so that the test program itself stays ordinary.
template <typename Body>
void on_a_thread(Body&& body) {
  std::thread(std::forward<Body>(body)).join();
}

std::string joined(const std::vector<std::string>& sentences) {
  std::string text;
  for (const std::string& sentence : sentences) text.append(sentence).append("\n");
  return text;
}

TEST(CpuList, AsTheKernelWritesThem) {
  EXPECT_THAT(cpus_from("0-3,8"), ElementsAre(0, 1, 2, 3, 8));
  EXPECT_THAT(cpus_from("2\n"), ElementsAre(2));
  for (const char* none : {"", "\n", "(null)", "a-b", "3-", "5-2", "-1"})
    EXPECT_THAT(cpus_from(none), IsEmpty()) << none;
  EXPECT_EQ(cpu_text({8, 0, 1, 3, 2, 2}), "0-3,8");
  EXPECT_EQ(cpu_text({}), "");
}

TEST(CpuList, TextOfAListReadsBackAsTheList) {
  constexpr unsigned kSeed = 20240611;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  for (int trial = 0; trial < 200; ++trial) {
    std::set<int> wanted;
    for (auto i = random() % 20; i > 0; --i) wanted.insert(static_cast<int>(random() % 64));
    const std::vector<int> list(wanted.begin(), wanted.end());
    EXPECT_EQ(cpus_from(cpu_text(list)), list);
  }
}

TEST(Realtime, NothingAskedNothingSaid) {
  on_a_thread([] {
    const std::vector<int> before = own_cpus();
    EXPECT_THAT(enter_realtime("a name longer than fifteen", {}, 0), IsEmpty());
    char name[32] = "";
    pthread_getname_np(pthread_self(), name, sizeof name);
    EXPECT_STREQ(name, "a name longer t");
    EXPECT_EQ(own_cpus(), before);
    EXPECT_EQ(own_scheduling().policy, SCHED_OTHER);
  });
  const ProcessRealtime process({});
  EXPECT_THAT(process.got(), IsEmpty());
  EXPECT_THAT(process.refused(), IsEmpty());
  EXPECT_EQ(locked_kb(), 0);
}

TEST(Realtime, APinnedThreadRunsThereOnly) {
  for (const int cpu : own_cpus())
    on_a_thread([cpu] {
      EXPECT_THAT(enter_realtime("pinned", {cpu}, 0), IsEmpty());
      EXPECT_THAT(own_cpus(), ElementsAre(cpu));
      EXPECT_EQ(sched_getcpu(), cpu);
    });
}

TEST(Realtime, ACpuThatIsNotThereIsRefusedAndChangesNothing) {
  if (sysconf(_SC_NPROCESSORS_CONF) > 1023) GTEST_SKIP() << "this machine has a CPU 1023";
  for (const int cpu : {1023, 1024, 100000, -1})
    on_a_thread([cpu] {
      const std::vector<int> before = own_cpus();
      const auto refused = enter_realtime("lost", {cpu}, 0);
      ASSERT_THAT(refused, SizeIs(1));
      EXPECT_THAT(refused[0], HasSubstr("lost"));
      EXPECT_THAT(refused[0], HasSubstr(std::to_string(cpu)));
      EXPECT_THAT(refused[0], HasSubstr("choose from CPUs " + cpu_text(before)));
      EXPECT_EQ(own_cpus(), before);
    });
}

TEST(Realtime, HalfOfTheCpusIsNotAllOfThem) {
  if (sysconf(_SC_NPROCESSORS_CONF) > 1023) GTEST_SKIP() << "this machine has a CPU 1023";
  // The kernel accepts a set of which only one CPU exists, and gives that one.
  on_a_thread([] {
    const int cpu = own_cpus().front();
    const auto refused = enter_realtime("half", {cpu, 1023}, 0);
    ASSERT_THAT(refused, SizeIs(1));
    EXPECT_THAT(refused[0], HasSubstr("1023"));
  });
}

TEST(Realtime, PriorityIsGotOrRefused) {
  on_a_thread([] {
    sched_param parameters{};
    parameters.sched_priority = 7;
    const bool permitted = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters) == 0;
    std::vector<std::string> refused;
    Scheduling got;
    std::thread([&] {  // the new thread inherits nothing from the thread that tried the permission
      parameters.sched_priority = 0;
      pthread_setschedparam(pthread_self(), SCHED_OTHER, &parameters);
      refused = enter_realtime("fast", {}, 12);
      got = own_scheduling();
    })
        .join();
    if (permitted) {
      EXPECT_THAT(refused, IsEmpty());
      EXPECT_EQ(got.policy, SCHED_FIFO);
      EXPECT_EQ(got.priority, 12);
    } else {
      EXPECT_THAT(refused, SizeIs(1));
      EXPECT_EQ(got.policy, SCHED_OTHER);
    }
  });
}

TEST(Realtime, AnOrdinaryUserIsToldHowToGetPriority) {
  const std::string said = as_ordinary_user(0, kEightMegabytes, [] {
    return joined(enter_realtime("detect", {}, 50)) + std::to_string(own_scheduling().policy);
  });
  for (const char* word : {"detect", "SCHED_FIFO 50", "RLIMIT_RTPRIO is 0", "LimitRTPRIO=50",
                           "CAP_SYS_NICE", "sched_rt_runtime_us", "\n0"})
    EXPECT_THAT(said, HasSubstr(word));
}

TEST(Realtime, AnOrdinaryUserWithTheLimitGetsPriority) {
  // Only root may raise a hard limit.
  if (geteuid() != 0) GTEST_SKIP() << "not root";
  const std::string said = as_ordinary_user(30, kEightMegabytes, [] {
    const std::string within = joined(enter_realtime("within", {}, 30));
    const int got = own_scheduling().priority;
    return within + std::to_string(got) + " " + joined(enter_realtime("beyond", {}, 31));
  });
  if (said == kNoSuchLimits) GTEST_SKIP() << "this root may not raise limits";
  // Its control group has no real-time run time.
  if (said.rfind("thread within", 0) == 0) GTEST_SKIP() << said;
  EXPECT_EQ(said.rfind("30 thread beyond", 0), 0U) << said;
  EXPECT_THAT(said, HasSubstr("RLIMIT_RTPRIO is 30"));
}

TEST(Realtime, AnOrdinaryUserIsNotLeftWithoutMemory) {
  const std::string said = as_ordinary_user(0, kEightMegabytes, [] {
    const ProcessRealtime process(memory_lock());
    // After mlockall(MCL_FUTURE) under the limit, all of this would fail.
    std::vector<std::vector<char>> memory;
    for (int i = 0; i < 16; ++i) memory.emplace_back(std::size_t{4} << 20, 'x');
    std::thread([] {}).join();
    return joined(process.got()) + "/" + joined(process.refused()) + std::to_string(locked_kb());
  });
  EXPECT_EQ(said.rfind("/memory is not locked", 0), 0U) << said;
  EXPECT_EQ(said.substr(said.size() - 2), "\n0") << said;
  for (const char* word : {"RLIMIT_MEMLOCK is 8 MB", "LimitMEMLOCK=infinity", "CAP_IPC_LOCK"})
    EXPECT_THAT(said, HasSubstr(word));
}

TEST(Realtime, UnderALargeLimitOnlyWhatIsThereIsLocked) {
  if (geteuid() != 0) GTEST_SKIP() << "not root";
  if (!locking_works()) GTEST_SKIP() << "mlockall does nothing here";
  // The limit is large against this program and small against what it allocates afterwards.
  constexpr rlim_t kLimit = rlim_t{2} << 30;
  const std::string said = as_ordinary_user(0, kLimit, [] {
    const ProcessRealtime process(memory_lock());
    void* later = mmap(nullptr, std::size_t{4} << 30, PROT_READ | PROT_WRITE,
                       MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    return joined(process.got()) + joined(process.refused()) +
           (later == MAP_FAILED ? "later failed" : "later fine") +
           (locked_kb() > 0 ? " locked" : " not locked");
  });
  if (said == kNoSuchLimits) GTEST_SKIP() << "this root may not raise limits";
  EXPECT_THAT(said, HasSubstr("memory locked ("));
  EXPECT_THAT(said, HasSubstr("what is allocated later is not: RLIMIT_MEMLOCK is 2048 MB"));
  EXPECT_THAT(said, HasSubstr("later fine locked"));
}

/// Returns whether the kernel holds the mapping at this address in memory. Memory that is allocated
/// need not be a new mapping, so sizes alone do not tell.
bool is_locked(const void* address) {
  std::ifstream smaps("/proc/self/smaps");
  bool is_its = false;
  for (std::string line; std::getline(smaps, line);) {
    std::uintptr_t begin = 0;
    std::uintptr_t end = 0;
    const auto at = reinterpret_cast<std::uintptr_t>(address);
    if (std::sscanf(line.c_str(), "%lx-%lx ", &begin, &end) == 2) is_its = at >= begin && at < end;
    if (is_its && line.rfind("VmFlags:", 0) == 0)
      return (line + " ").find(" lo ") != std::string::npos;
  }
  return false;
}

TEST(Realtime, MemoryIsLockedAsLongAsTheObjectLives) {
  if (geteuid() != 0) GTEST_SKIP() << "not root";
  if (!locking_works()) GTEST_SKIP() << "mlockall does nothing here";
  const long without_kb = locked_kb();
  {
    const ProcessRealtime process(memory_lock());
    ASSERT_THAT(process.got(), SizeIs(1));
    EXPECT_THAT(process.got()[0], HasSubstr("memory locked ("));
    EXPECT_THAT(process.refused(), IsEmpty());
    EXPECT_GT(locked_kb(), without_kb);
    const std::vector<char> later(std::size_t{32} << 20, 'x');
    EXPECT_TRUE(is_locked(later.data()));
    EXPECT_TRUE(is_locked(&later.back()));
  }
  EXPECT_EQ(locked_kb(), without_kb);
}

TEST(Realtime, HugePagesHoldWhatIsThereAndKeepIt) {
  const auto huge_kb = [] { return kilobytes("/proc/self/smaps_rollup", "AnonHugePages"); };
  if (huge_kb() < 0) GTEST_SKIP() << "the kernel does not count huge pages";
  constexpr std::size_t kBytes = std::size_t{64} << 20;
  std::vector<char> buffer(kBytes);
  for (std::size_t i = 0; i < kBytes; i += 512) buffer[i] = static_cast<char>(i / 512 % 101);
  const ProcessRealtime process(huge_pages());
  EXPECT_EQ(process.got().size() + process.refused().size(), 1U);
  for (std::size_t i = 0; i < kBytes; i += 512)
    ASSERT_EQ(buffer[i], static_cast<char>(i / 512 % 101));
  if (process.got().empty()) GTEST_SKIP() << process.refused()[0];
  EXPECT_THAT(process.got()[0], HasSubstr("huge pages ("));
  EXPECT_GE(huge_kb(), 2048);
}

TEST(Realtime, CStatesAreHeldAsLongAsTheObjectLives) {
  const auto held_us = [] {
    const int device = open("/dev/cpu_dma_latency", O_RDONLY | O_CLOEXEC);
    std::int32_t value = -1;
    if (device < 0 || read(device, &value, sizeof value) != sizeof value) value = -1;
    if (device >= 0) close(device);
    return value;
  };
  const std::int32_t before = held_us();
  if (before < 0 || access("/dev/cpu_dma_latency", W_OK) != 0)
    GTEST_SKIP() << "/dev/cpu_dma_latency cannot be used here";
  {
    const ProcessRealtime process(longest_wakeup(7));
    EXPECT_THAT(process.got(), SizeIs(1));
    EXPECT_THAT(process.refused(), IsEmpty());
    EXPECT_LE(held_us(), 7);
  }
  EXPECT_EQ(held_us(), before);
}

TEST(Realtime, AnOrdinaryUserIsToldHowToHoldCStates) {
  if (geteuid() != 0) GTEST_SKIP() << "this user may have the right";
  const std::string said = as_ordinary_user(0, kEightMegabytes, [] {
    const ProcessRealtime process(longest_wakeup(0));
    return joined(process.got()) + "/" + joined(process.refused());
  });
  if (said.rfind("/", 0) != 0) GTEST_SKIP() << "everybody has the right: " << said;
  EXPECT_EQ(said.rfind("/C-states are not held", 0), 0U) << said;
  EXPECT_THAT(said, HasSubstr("/dev/cpu_dma_latency"));
}

}  // namespace
}  // namespace curlew
