// curlew doctor: what it says of a given machine, and how the command behaves for a user.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "service/doctor/machine_check.h"
#include "service/doctor/wakeup_jitter.h"
#include "tests/support/ordinary_user.h"
#include "tests/support/paths.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr const char* kCpus = "/sys/devices/system/cpu/";
constexpr const char* kClock = "/sys/devices/system/clocksource/clocksource0/";
constexpr const char* kHugePages = "/sys/kernel/mm/transparent_hugepage/enabled";
constexpr const char* kUsbMemory = "/sys/module/usbcore/parameters/usbfs_memory_mb";
constexpr const char* kNic = "/sys/class/net/eno1/";

std::string limits(const std::string& rtprio, const std::string& memlock) {
  return "Limit                     Soft Limit           Hard Limit           Units     \n"
         "Max locked memory         65536                " +
         memlock +
         "              bytes     \n"
         "Max realtime priority     0                    " +
         rtprio + "                   \n";
}
std::string snmp(const std::string& in_errors, const std::string& buffer_errors) {
  std::string text = "Tcp: ActiveOpens InErrs\nTcp: 3 77\n";
  text += "Udp: InDatagrams NoPorts InErrors OutDatagrams RcvbufErrors SndbufErrors\n";
  return text + "Udp: 123456 0 " + in_errors + " 99 " + buffer_errors + " 0\n";
}

/// Returns a line of /proc/net/route. The kernel prints addresses as whole numbers of their bytes
/// in memory.
std::string route(const char* interface, const char* destination, const char* mask,
                  const char* gateway = "0.0.0.0", int metric = 0) {
  const unsigned flags = std::string(gateway) == "0.0.0.0" ? 1 : 3;
  std::array<char, 128> line{};
  std::snprintf(line.data(), line.size(), "%s\t%08X\t%08X\t%04X\t0\t0\t%d\t%08X\t0\t0\t0   \n",
                interface, inet_addr(destination), inet_addr(gateway), flags, metric,
                inet_addr(mask));
  return line.data();
}

/// A machine that has everything one could wish for, until a test changes one of its files.
class MadeUpMachine : public ::testing::Test {
 protected:
  MadeUpMachine() {
    machine_.root = root_.path();
    machine_.build_type = "Release";
    machine_.config.pipeline.cpus = {4, 5};
    machine_.config.realtime.camera_cpus = {6};
    machine_.config.realtime.priority = 50;
    machine_.config.realtime.camera_priority = 60;
    write("/proc/self/limits", limits("95", "unlimited"));
    write("/proc/self/status", "Name:\tcurlew\nCapEff:\t0000000000000000\n");
    write("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu tsc avx512f\n");
    write("/proc/version", "Linux version 6.1.0-rt (x@y) #1 SMP PREEMPT_RT Debian\n");
    write("/proc/swaps", "Filename\tType\tSize\tUsed\tPriority\n");
    write("/proc/net/snmp", snmp("0", "0"));
    write("/proc/sys/kernel/sched_rt_runtime_us", "950000\n");
    write("/proc/sys/kernel/sched_rt_period_us", "1000000\n");
    write("/proc/sys/net/core/rmem_max", "33554432\n");
    write(kCpus + std::string("online"), "0-7\n");
    write(kCpus + std::string("isolated"), "4-7\n");
    write(kCpus + std::string("nohz_full"), "4-7\n");
    write(kCpus + std::string("smt/active"), "0\n");
    write(kCpus + std::string("intel_pstate/no_turbo"), "0\n");
    for (const char* cpu : {"cpu0", "cpu7"})
      write(std::string(kCpus) + cpu + "/cpufreq/scaling_governor", "performance\n");
    c_state("state0", "POLL", "0");
    c_state("state1", "C1", "2");
    write("/dev/cpu_dma_latency", "");
    write(kClock + std::string("current_clocksource"), "tsc\n");
    write(kClock + std::string("available_clocksource"), "tsc hpet acpi_pm \n");
    write(kHugePages, "always [madvise] never\n");
    write(kUsbMemory, "1000\n");
    interface("lo", "65536", false);
    interface("eno1", "9000", true);
    routes(route("eno1", "0.0.0.0", "0.0.0.0", "192.168.1.1") +
           route("eno1", "192.168.1.0", "255.255.255.0"));
  }

  void write(const std::string& path, const std::string& text) const {
    const std::filesystem::path file = root_.path() + path;
    std::filesystem::create_directories(file.parent_path());
    write_bytes(file.string(), text);
  }
  void remove(const std::string& path) const { std::filesystem::remove_all(root_.path() + path); }
  void c_state(const std::string& state, const char* name, const char* latency_us) const {
    const std::string folder = std::string(kCpus) + "cpu0/cpuidle/" + state;
    write(folder + "/name", std::string(name) + "\n");
    write(folder + "/latency", std::string(latency_us) + "\n");
    write(folder + "/disable", "0\n");
  }
  void interface(const std::string& name, const char* mtu, bool is_hardware) const {
    const std::string folder = "/sys/class/net/" + name;
    write(folder + "/mtu", std::string(mtu) + "\n");
    write(folder + "/operstate", "up\n");
    write(folder + "/statistics/rx_packets", "1000000\n");
    write(folder + "/statistics/rx_dropped", "12\n");
    write(folder + "/statistics/rx_missed_errors", "0\n");
    if (is_hardware) write(folder + "/device/vendor", "0x8086\n");
  }

  void routes(const std::string& lines) const {
    write("/proc/net/route",
          "Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT \n" +
              lines);
  }

  Check check(const std::string& name) const {
    for (const Check& check : check_machine(machine_))
      if (check.name == name) return check;
    ADD_FAILURE() << "no check " << name;
    return {};
  }
  /// Expects that this one check has the verdict and the words, and that all other checks are good.
  void expect(const std::string& name, CheckVerdict verdict,
              const std::vector<std::string>& words) const {
    SCOPED_TRACE(name);
    const Check found = check(name);
    EXPECT_EQ(word_of(found.verdict), word_of(verdict)) << found.found;
    std::string text = found.found + "\n" + found.advice + "\n";
    for (const std::string& command : found.commands) text += command + "\n";
    for (const std::string& word : words) EXPECT_THAT(text, HasSubstr(word));
    if (verdict == CheckVerdict::kCouldBeBetter || verdict == CheckVerdict::kBad)
      EXPECT_NE(found.advice, "");
    else
      EXPECT_EQ(found.advice, "");
    for (const Check& other : check_machine(machine_)) {
      if (other.name == name) continue;
      EXPECT_EQ(word_of(other.verdict), "good") << other.name << ": " << other.found;
    }
  }

  ScratchDirectory root_;
  Machine machine_;
};

TEST_F(MadeUpMachine, AllGood) {
  const std::vector<Check> checks = check_machine(machine_);
  EXPECT_GE(checks.size(), 18U);
  for (const Check& check : checks) {
    EXPECT_EQ(word_of(check.verdict), "good") << check.name << ": " << check.found;
    EXPECT_NE(check.found, "") << check.name;
    EXPECT_EQ(check.advice, "") << check.name;
    EXPECT_THAT(check.commands, IsEmpty()) << check.name;
  }
  EXPECT_TRUE(ready_for_real_time(checks));
}

TEST(Doctor, AMachineThatShowsNothingIsNotSeenAndHarmsNobody) {
  const ScratchDirectory empty;
  const Machine machine{.root = empty.path(), .config = {}, .build_type = "Release"};
  std::map<std::string_view, int> count;
  for (const Check& check : check_machine(machine)) ++count[word_of(check.verdict)];
  EXPECT_GE(count["not seen"], 10);
  EXPECT_EQ(count["bad"], 2) << "a machine that shows no limits has no rights";
}

TEST_F(MadeUpMachine, ADebugBuild) {
  machine_.build_type = "Debug";
  expect("build", CheckVerdict::kBad, {"Debug", "./dev build"});
  EXPECT_FALSE(ready_for_real_time(check_machine(machine_)));
}

TEST_F(MadeUpMachine, PriorityBelowWhatTheConfigurationAsks) {
  write("/proc/self/limits", limits("59", "unlimited"));
  expect("real-time priority", CheckVerdict::kBad,
         {"RLIMIT_RTPRIO is 59", "priority 60", "rtprio 99"});
  write("/proc/self/limits", limits("60", "unlimited"));
  expect("real-time priority", CheckVerdict::kGood, {"RLIMIT_RTPRIO is 60"});
  write("/proc/self/limits", limits("0", "unlimited"));
  write("/proc/self/status", "CapEff:\t0000000000800000\n");
  expect("real-time priority", CheckVerdict::kGood, {"with CAP_SYS_NICE"});
}

TEST_F(MadeUpMachine, MemoryThatCannotBeLocked) {
  write("/proc/self/limits", limits("95", "8388608"));
  expect("memory lock", CheckVerdict::kBad, {"RLIMIT_MEMLOCK is 8 MB", "memlock unlimited"});
  write("/proc/self/status", "CapEff:\t0000000000004000\n");
  expect("memory lock", CheckVerdict::kGood, {"with CAP_IPC_LOCK"});
}

TEST_F(MadeUpMachine, Governor) {
  write(kCpus + std::string("cpu7/cpufreq/scaling_governor"), "powersave\n");
  expect("CPU frequency", CheckVerdict::kBad,
         {"performance, powersave", "turbo on", "echo performance | sudo tee"});
  remove(kCpus + std::string("cpu0/cpufreq"));
  remove(kCpus + std::string("cpu7/cpufreq"));
  expect("CPU frequency", CheckVerdict::kNotSeen, {"cannot be seen here"});
}

TEST_F(MadeUpMachine, DeepCStates) {
  c_state("state2", "C6", "133");
  expect("C-states", CheckVerdict::kCouldBeBetter, {"C6", "133 µs", "max_cpu_wakeup_us"});
  machine_.config.realtime.max_cpu_wakeup_us = 0;
  expect("C-states", CheckVerdict::kGood, {"holds it to 0 µs"});
  machine_.config.realtime.max_cpu_wakeup_us = -1;
  write(kCpus + std::string("cpu0/cpuidle/state2/disable"), "1\n");
  expect("C-states", CheckVerdict::kGood, {"C1", "2 µs"});
  remove(kCpus + std::string("cpu0/cpuidle"));
  expect("C-states", CheckVerdict::kNotSeen, {"cannot be seen here"});
}

TEST_F(MadeUpMachine, NoLatencyDevice) {
  remove("/dev/cpu_dma_latency");
  expect("C-state hold", CheckVerdict::kNotSeen, {"no /dev/cpu_dma_latency"});
}

TEST_F(MadeUpMachine, Processors) {
  write(kCpus + std::string("smt/active"), "1\n");
  expect("CPUs", CheckVerdict::kCouldBeBetter, {"8 CPUs (0-7)", "SMT", "smt/control"});
  write(kCpus + std::string("smt/active"), "0\n");
  machine_.config.pipeline.cpus = {4, 8, 9};
  const Check pinning = check("pinning");
  EXPECT_EQ(pinning.verdict, CheckVerdict::kBad);
  EXPECT_THAT(pinning.found, HasSubstr("4,6,8-9"));
  EXPECT_THAT(pinning.advice, HasSubstr("CPU 8-9 is not there"));
  machine_.config.pipeline.cpus = {};
  machine_.config.realtime.camera_cpus = {};
  expect("pinning", CheckVerdict::kCouldBeBetter, {"[pipeline] cpus"});
}

TEST_F(MadeUpMachine, OneCpu) {
  write(kCpus + std::string("online"), "0\n");
  const Check cpus = check("CPUs");
  EXPECT_EQ(cpus.verdict, CheckVerdict::kBad);
  EXPECT_THAT(cpus.found, HasSubstr("1 CPUs (0)"));
}

TEST_F(MadeUpMachine, Isolation) {
  machine_.config.pipeline.cpus = {2, 5};
  expect("isolated CPUs", CheckVerdict::kCouldBeBetter, {"4-7", "uses CPU 2,"});
  machine_.config.pipeline.cpus = {4, 5};
  write(kCpus + std::string("isolated"), "\n");
  write(kCpus + std::string("nohz_full"), "(null)\n");
  expect("isolated CPUs", CheckVerdict::kCouldBeBetter,
         {"isolated: none", "nohz_full): none", "isolcpus=4-7 nohz_full=4-7", "update-grub"});
  write(kCpus + std::string("online"), "0-1\n");
  machine_.config.pipeline.cpus = {0};
  machine_.config.realtime.camera_cpus = {1};
  expect("isolated CPUs", CheckVerdict::kGood, {"with so few CPUs"});
}

TEST_F(MadeUpMachine, Host) {
  write("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu hypervisor\n");
  expect("host", CheckVerdict::kCouldBeBetter, {"a virtual machine"});
}

TEST_F(MadeUpMachine, Kernel) {
  write("/proc/version", "Linux version 6.1.0-18 (x@y) #1 SMP PREEMPT_DYNAMIC Debian\n");
  expect("kernel", CheckVerdict::kCouldBeBetter,
         {"6.1.0-18", "without PREEMPT_RT", "linux-image-rt"});
  write("/sys/kernel/realtime", "1\n");
  expect("kernel", CheckVerdict::kGood, {"with PREEMPT_RT"});
}

TEST_F(MadeUpMachine, Throttling) {
  const std::string setting = "/proc/sys/kernel/sched_rt_runtime_us";
  write(setting, "-1\n");
  expect("real-time throttling", CheckVerdict::kGood, {"never"});
  write(setting, "500000\n");
  expect("real-time throttling", CheckVerdict::kCouldBeBetter,
         {"50 %", "sudo sysctl -w kernel.sched_rt_runtime_us=950000"});
  write(setting, "0\n");
  expect("real-time throttling", CheckVerdict::kBad, {"0 %"});
}

TEST_F(MadeUpMachine, ClockSource) {
  write(kClock + std::string("current_clocksource"), "hpet\n");
  expect("clock source", CheckVerdict::kBad, {"hpet", "echo tsc | sudo tee"});
  write(kClock + std::string("available_clocksource"), "hpet acpi_pm \n");
  expect("clock source", CheckVerdict::kBad, {"dmesg"});
  EXPECT_THAT(check("clock source").commands, IsEmpty());
  write(kClock + std::string("current_clocksource"), "kvm-clock\n");
  expect("clock source", CheckVerdict::kGood, {"kvm-clock"});
}

TEST_F(MadeUpMachine, HugePages) {
  write(kHugePages, "always madvise [never]\n");
  expect("huge pages", CheckVerdict::kCouldBeBetter, {"echo madvise | sudo tee"});
  write(kHugePages, "[always] madvise never\n");
  expect("huge pages", CheckVerdict::kCouldBeBetter, {"unasked"});
}

TEST_F(MadeUpMachine, Swap) {
  write("/proc/swaps", "Filename\tType\n/dev/sda2 partition 8388604 0 -2\n");
  expect("swap", CheckVerdict::kCouldBeBetter, {"lock_memory", "swapoff"});
  machine_.config.realtime.lock_memory = true;
  expect("swap", CheckVerdict::kGood, {"locks"});
}

TEST_F(MadeUpMachine, SocketBuffer) {
  machine_.config.camera.socket_buffer_bytes = 12345678;
  write("/proc/sys/net/core/rmem_max", "12345678\n");
  expect("socket buffer", CheckVerdict::kGood, {});
  write("/proc/sys/net/core/rmem_max", "12345677\n");
  expect("socket buffer", CheckVerdict::kCouldBeBetter, {"12345677", "net.core.rmem_max=12345678"});
  write("/proc/sys/net/core/rmem_max", "212992\n");  // the default of Debian
  expect("socket buffer", CheckVerdict::kBad, {"212992", "net.core.rmem_max=12345678"});
}

constexpr const char* kJumboAnywhere =
    "sudo ip link set INTERFACE mtu 9000  # INTERFACE: the camera's";

TEST_F(MadeUpMachine, JumboFramesOnTheInterfaceOfTheCamerasNetwork) {
  interface("eno1", "1500", true);  // it leads to everything else
  interface("enp3s0", "1500", true);
  routes(route("eno1", "0.0.0.0", "0.0.0.0", "192.168.1.1") +
         route("eno1", "192.168.1.0", "255.255.255.0") +
         route("enp3s0", "192.168.7.0", "255.255.255.0"));
  machine_.config.camera.source = "aravis:192.168.7.2";
  expect("jumbo frames", CheckVerdict::kCouldBeBetter, {"enp3s0 MTU 1500", "camera 192.168.7.2"});
  EXPECT_THAT(check("jumbo frames").found, Not(HasSubstr("eno1")));
  EXPECT_THAT(check("jumbo frames").commands, ElementsAre("sudo ip link set enp3s0 mtu 9000"));
  interface("enp3s0", "9000", true);
  expect("jumbo frames", CheckVerdict::kGood, {"enp3s0 MTU 9000"});

  // Now the camera is on the office's network.
  machine_.config.camera.source = "aravis:192.168.1.77";
  EXPECT_THAT(check("jumbo frames").commands, ElementsAre("sudo ip link set eno1 mtu 9000"));
}

TEST_F(MadeUpMachine, ACameraOnANetworkWithOthers) {
  interface("enp3s0", "9000", true);
  interface("eno1", "9000", true);
  machine_.config.camera.source = "aravis:192.168.7.2";
  const std::string office = route("eno1", "0.0.0.0", "0.0.0.0", "192.168.1.1") +
                             route("eno1", "192.168.1.0", "255.255.255.0");
  routes(office + route("enp3s0", "192.168.7.0", "255.255.255.0"));
  const std::string columns = "IP address  HW type  Flags  HW address  Mask  Device\n";
  const std::string camera = "192.168.7.2  0x1  0x2  00:30:53:00:00:01  *  enp3s0\n";
  const std::string elsewhere = "192.168.1.1  0x1  0x2  00:30:53:00:00:02  *  eno1\n";
  const std::string silent = "192.168.7.8  0x1  0x0  00:00:00:00:00:00  *  enp3s0\n";
  write("/proc/net/arp", columns + camera + elsewhere + silent);
  expect("camera's network", CheckVerdict::kGood, {"nobody but the camera is seen on enp3s0"});
  const std::string stranger = "192.168.7.9  0x1  0x2  00:30:53:00:00:03  *  enp3s0\n";
  write("/proc/net/arp", columns + camera + stranger);
  expect("camera's network", CheckVerdict::kCouldBeBetter,
         {"enp3s0", "shared with 192.168.7.9", "no password", "an interface of its own"});
  machine_.config.camera.source = "aravis:192.168.1.77";
  expect("camera's network", CheckVerdict::kCouldBeBetter,
         {"eno1", "shared with the default route"});
}

TEST_F(MadeUpMachine, JumboFramesOnTheInterfaceThatLeadsToTheCamera) {
  machine_.config.camera.source = "aravis:10.20.30.40";
  interface("bond0", "1500", false);  // no hardware, but it leads to the camera
  const std::string wide = route("eno1", "10.0.0.0", "255.0.0.0");
  const std::string narrow = route("bond0", "10.20.0.0", "255.255.0.0", "10.1.1.1", 100);
  for (const std::string& lines : {wide + narrow, narrow + wide}) {
    routes(lines);
    expect("jumbo frames", CheckVerdict::kCouldBeBetter, {"bond0 MTU 1500"});
    EXPECT_THAT(check("jumbo frames").commands, ElementsAre("sudo ip link set bond0 mtu 9000"));
  }
  const std::string cheaper = route("eno1", "10.20.0.0", "255.255.0.0", "0.0.0.0", 50);
  for (const std::string& lines : {cheaper + narrow, narrow + cheaper}) {
    routes(lines);
    expect("jumbo frames", CheckVerdict::kGood, {"eno1 MTU 9000"});
  }
}

TEST_F(MadeUpMachine, JumboFramesAreNotAskedOfTheDefaultRoute) {
  interface("eno1", "1500", true);
  machine_.config.camera.source = "aravis:192.168.7.2";
  const std::string everywhere = route("eno1", "0.0.0.0", "0.0.0.0", "192.168.1.1");
  const std::string halves = route("eno1", "0.0.0.0", "128.0.0.0", "10.8.0.1") +
                             route("eno1", "128.0.0.0", "128.0.0.0", "10.8.0.1");
  for (const std::string& lines : {everywhere, halves, std::string()}) {
    routes(lines);
    expect("jumbo frames", CheckVerdict::kCouldBeBetter,
           {"no interface has the network of the camera 192.168.7.2"});
    EXPECT_THAT(check("jumbo frames").commands, ElementsAre(kJumboAnywhere));
  }
}

TEST_F(MadeUpMachine, JumboFramesOfACameraThatIsNotKnownByItsAddress) {
  interface("eno1", "1500", true);
  interface("enp3s0", "1500", true);
  interface("docker0", "1500", false);
  interface("lo", "1500", false);
  for (const char* source : {"aravis:", "aravis:Basler-acA2040-120um-22801234"}) {
    machine_.config.camera.source = source;
    expect("jumbo frames", CheckVerdict::kCouldBeBetter,
           {"eno1 MTU 1500; enp3s0 MTU 1500", "cannot be known from", source});
    EXPECT_THAT(check("jumbo frames").commands, ElementsAre(kJumboAnywhere));
  }
  write("/sys/class/net/enp3s0/operstate", "down\n");
  write("/sys/class/net/eno1/mtu", "9000\n");
  expect("jumbo frames", CheckVerdict::kGood, {"eno1"});
}

TEST_F(MadeUpMachine, NoJumboFramesForACameraThatIsNotOnANetwork) {
  interface("eno1", "1500", true);
  write(kNic + std::string("statistics/rx_missed_errors"), "3\n");
  for (const char* source : {"usb:1ab2:0001", "sim:dipole", "file:night.fits"}) {
    machine_.config.camera.source = source;
    expect("jumbo frames", CheckVerdict::kGood, {source, "not on a network"});
    expect("interface losses", CheckVerdict::kGood, {source, "not on a network"});
  }
  machine_.config.camera.source = "aravis:127.0.0.1";
  expect("jumbo frames", CheckVerdict::kGood, {"lo MTU 65536"});
}

TEST_F(MadeUpMachine, LostPackets) {
  write("/proc/net/snmp", snmp("7", "5"));
  expect("UDP losses", CheckVerdict::kCouldBeBetter,
         {"123456 datagrams", "7 lost", "5 of them", "socket_buffer_bytes"});
  write("/proc/net/snmp", snmp("7", "0"));
  expect("UDP losses", CheckVerdict::kCouldBeBetter, {"7 lost", "cable"});
}

TEST_F(MadeUpMachine, LossesOfTheCamerasInterface) {
  interface("enp3s0", "9000", true);
  write("/sys/class/net/enp3s0/statistics/rx_missed_errors", "4\n");
  routes(route("eno1", "192.168.1.0", "255.255.255.0"));
  machine_.config.camera.source = "aravis:192.168.1.77";
  expect("interface losses", CheckVerdict::kGood, {"eno1: 1000000 packets", "0 missed"});
  write(kNic + std::string("statistics/rx_missed_errors"), "3\n");
  expect("interface losses", CheckVerdict::kCouldBeBetter,
         {"3 missed", "sudo ethtool -G eno1 rx 4096"});
  write(kNic + std::string("statistics/rx_missed_errors"), "0\n");
  write(kNic + std::string("statistics/rx_dropped"), "1001\n");
  expect("interface losses", CheckVerdict::kCouldBeBetter, {"1001 dropped"});
  machine_.config.camera.source = "aravis:";
  expect("interface losses", CheckVerdict::kCouldBeBetter,
         {"4 missed", "sudo ethtool -G INTERFACE rx"});
}

TEST_F(MadeUpMachine, UsbMemory) {
  write(kUsbMemory, "16\n");
  expect("USB memory", CheckVerdict::kCouldBeBetter, {"usbfs_memory_mb is 16", "echo 1000"});
  write(kUsbMemory, "0\n");
  expect("USB memory", CheckVerdict::kGood, {"no limit"});
  remove("/sys/module/usbcore");
  expect("USB memory", CheckVerdict::kNotSeen, {"no USB"});
}

TEST_F(MadeUpMachine, NonsenseInFilesIsNoMoreThanNotSeen) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root_.path()))
    if (entry.is_regular_file()) write_bytes(entry.path().string(), std::string("\xff\0-,\n\n", 6));
  for (const Check& check : check_machine(machine_)) EXPECT_NE(check.found, "") << check.name;
}

TEST(WakeupJitter, CountsEveryWakeUpOnce) {
  const WakeupJitter jitter = measure_wakeup_jitter(0.1, {}, 0);
  EXPECT_THAT(jitter.refused, IsEmpty());
  EXPECT_GE(jitter.late_ns.count(), 1U);
  EXPECT_LE(jitter.late_ns.count(), 101U);
  EXPECT_GT(jitter.late_ns.max_ns(), 0);
}

TEST(WakeupJitter, IsNotMeasuredAtAPriorityThatWasRefused) {
  const std::string said = as_ordinary_user(0, 0, [] {
    const WakeupJitter jitter = measure_wakeup_jitter(0.05, {}, 80);
    return std::to_string(jitter.refused.size()) + " " + std::to_string(jitter.late_ns.count());
  });
  EXPECT_EQ(said, "1 0");
}

TEST(Doctor, TellsOfThisMachine) {
  const ScratchDirectory scratch;
  const ProgramRun run = run_curlew(scratch, "doctor --seconds 0.1");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.err, "");
  for (const char* word : {"RLIMIT_RTPRIO", "RLIMIT_MEMLOCK", "rmem_max", "wake-ups late by",
                           "ordinary", "SCHED_FIFO", "ready for real time"})
    EXPECT_THAT(run.out, HasSubstr(word));
}

TEST(Doctor, TellsPrograms) {
  const ScratchDirectory scratch;
  write_bytes(scratch / "c.toml", "[camera]\nsocket_buffer_bytes = 1073741824\n");
  const ProgramRun run = run_curlew(scratch, "doctor --json --seconds 0.05 --config c.toml");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto told = nlohmann::json::parse(run.out);
  EXPECT_TRUE(told["ready"].is_boolean());
  EXPECT_GE(told["checks"].size(), 18U);
  bool any_bad = false;
  for (const auto& check : told["checks"]) {
    EXPECT_THAT(kVerdictWords, Contains(check["verdict"].get<std::string>()));
    any_bad = any_bad || check["verdict"] == "bad";
    if (check["name"] == "socket buffer") {
      EXPECT_THAT(check["found"].get<std::string>(), HasSubstr("1073741824"));
    }
  }
  EXPECT_EQ(told["ready"].get<bool>(), !any_bad);
  EXPECT_GE(told["wakeup_jitter_us"]["ordinary"]["wakeups"].get<int>(), 1);
  const auto& ordinary = told["wakeup_jitter_us"]["ordinary"];
  EXPECT_LE(ordinary["p50"].get<double>(), ordinary["max"].get<double>());
}

TEST(Doctor, RefusesWhatItCannotRead) {
  const ScratchDirectory scratch;
  const ProgramRun missing = run_curlew(scratch, "doctor --config none.toml --seconds 0");
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.err, HasSubstr("none.toml"));
  const ProgramRun backwards = run_curlew(scratch, "doctor --seconds -1");
  EXPECT_EQ(backwards.exit_code, 2);
  EXPECT_THAT(backwards.err, HasSubstr("--seconds"));
}

TEST(PackagedConfiguration, IsReadAndHoldsEverySettingAtItsDefault) {
  const std::string file = std::string(kSourceDir) + "/packaging/curlew.toml";
  Config expected;  // the defaults, except for the service's own folders and rights
  expected.daemon.sensor = "/etc/curlew/sensor.fits";
  expected.daemon.control = "/run/curlew/control";
  expected.realtime.priority = 50;
  expected.realtime.camera_priority = 60;
  expected.realtime.lock_memory = true;
  expected.realtime.huge_pages = true;
  expected.recorder.folder = "/var/lib/curlew";
  EXPECT_EQ(config_text(read_config(file)), config_text(expected));

  // Every comment that looks like a setting is one, and every setting is shown.
  std::string text = read_bytes(file);
  std::string uncommented;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t equals = line.find(" = ");
    const bool setting =
        line.rfind("# ", 0) == 0 && equals != std::string::npos && line.find(' ', 2) == equals;
    uncommented.append(setting ? line.substr(2) : line).append("\n");
  }
  const ScratchDirectory scratch;
  write_bytes(scratch / "all.toml", uncommented);
  EXPECT_EQ(config_text(read_config(scratch / "all.toml")), config_text(expected));
  std::istringstream settings(config_text(expected));
  for (std::string line; std::getline(settings, line);) {
    std::string shown("\n");
    shown.append(line.empty() || line[0] == '[' ? line : line.substr(0, line.find(" = ") + 3));
    EXPECT_THAT(uncommented, HasSubstr(shown));
  }
}

}  // namespace
}  // namespace curlew
