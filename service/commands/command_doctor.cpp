#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "acquisition/usb/usb_devices.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/doctor/machine_check.h"
#include "service/doctor/wakeup_jitter.h"
#include "service/program/version.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct DoctorOptions {
  std::string config;
  double seconds = 3.0;
  bool json = false;
};

struct JitterRow {
  std::string name;
  WakeupJitter jitter;
};

constexpr std::array<std::pair<const char*, double>, 4> kPercentiles = {
    {{"p50", 0.5}, {"p99", 0.99}, {"p99.9", 0.999}, {"max", 1.0}}};

double microseconds(const LatencyHistogram& histogram, double fraction) {
  return static_cast<double>(histogram.percentile_ns(fraction)) * 1e-3;
}

std::vector<JitterRow> measure_jitter(const Config& config, double seconds) {
  if (seconds <= 0.0) return {};
  constexpr int kPriority = 80;
  const int priority = config.realtime.priority > 0 ? config.realtime.priority : kPriority;
  const std::vector<int>& cpus = config.pipeline.cpus;
  std::vector<JitterRow> rows;
  rows.push_back({"ordinary", measure_wakeup_jitter(seconds, cpus, 0)});
  rows.push_back(
      {fmt::format("SCHED_FIFO {}", priority), measure_wakeup_jitter(seconds, cpus, priority)});
  return rows;
}

/// Returns the commands of all checks with this verdict.
std::vector<std::string> commands_of(const std::vector<Check>& checks, CheckVerdict verdict) {
  std::vector<std::string> commands;
  for (const Check& check : checks)
    if (check.verdict == verdict)
      commands.insert(commands.end(), check.commands.begin(), check.commands.end());
  return commands;
}

void print_json(const std::vector<Check>& checks, const std::vector<JitterRow>& rows) {
  nlohmann::ordered_json json = machine_json();
  json["user_id"] = geteuid();
  json["checks"] = nlohmann::ordered_json::array();
  for (const Check& check : checks)
    json["checks"].push_back({{"name", check.name},
                              {"verdict", word_of(check.verdict)},
                              {"found", check.found},
                              {"advice", check.advice},
                              {"commands", check.commands}});
  json["wakeup_jitter_us"] = nlohmann::ordered_json::object();
  for (const JitterRow& row : rows) {
    nlohmann::ordered_json& entry = json["wakeup_jitter_us"][row.name];
    if (!row.jitter.refused.empty()) entry["refused"] = row.jitter.refused;
    entry["wakeups"] = row.jitter.late_ns.count();
    if (row.jitter.late_ns.count() == 0) continue;
    for (const auto& [name, fraction] : kPercentiles)
      entry[name] = microseconds(row.jitter.late_ns, fraction);
  }
  json["ready"] = ready_for_real_time(checks);
  fmt::print("{}\n", json.dump(2));
}

void print_jitter(const std::vector<JitterRow>& rows) {
  if (rows.empty()) return;
  fmt::print("\nwake-ups late by, µs");
  for (const auto& [name, fraction] : kPercentiles) fmt::print("{:>10}", name);
  fmt::print("\n");
  for (const JitterRow& row : rows) {
    fmt::print("{:<20}", row.name);
    if (row.jitter.late_ns.count() == 0)
      fmt::print("not measured");
    else
      for (const auto& [name, fraction] : kPercentiles)
        fmt::print("{:>10.1f}", microseconds(row.jitter.late_ns, fraction));
    fmt::print("\n");
    for (const std::string& sentence : row.jitter.refused) fmt::print("  {}\n", sentence);
  }
}

void print_commands(const std::vector<std::string>& commands) {
  for (const std::string& command : commands) fmt::print("  {}\n", command);
}

void print_text(const std::vector<Check>& checks, const std::vector<JitterRow>& rows) {
  fmt::print("{}, checked as user {}\n\n", kProgram, geteuid());
  for (const Check& check : checks) {
    fmt::print("{:<17}{:<22}{}\n", word_of(check.verdict), check.name, check.found);
    if (!check.advice.empty()) fmt::print("{:39}→ {}\n", "", check.advice);
  }
  print_jitter(rows);
  const std::vector<std::string> needed = commands_of(checks, CheckVerdict::kBad);
  const std::vector<std::string> useful = commands_of(checks, CheckVerdict::kCouldBeBetter);
  fmt::print("\n{}\n", ready_for_real_time(checks) ? "ready for real time"
                       : needed.empty()            ? "not ready for real time: see what is bad"
                                                   : "not ready for real time; what makes it so:");
  print_commands(needed);
  if (!useful.empty()) fmt::print("what makes it better{}:\n", needed.empty() ? "" : " still");
  print_commands(useful);
}

/// Checks the USB cameras of this machine for what is in their way.
Check check_usb_cameras(const Config& config) {
  Check check;
  check.name = "USB cameras";
  check.found = "nothing is in their way";
  try {
    for (const std::string& sentence : usb_advice(config.camera.usb))
      check.advice.append(check.advice.empty() ? "" : "; ").append(sentence);
    if (check.advice.empty()) return check;
    check.verdict = CheckVerdict::kCouldBeBetter;
    check.found = "they cannot all be used";
  } catch (const Failure& failure) {
    check.verdict = CheckVerdict::kNotSeen;
    check.found = failure.what();
  }
  return check;
}

void examine(const DoctorOptions& options) {
  Machine machine{.root = "", .config = {}, .build_type = kBuildType};
  if (!options.config.empty()) machine.config = read_config(options.config);
  std::vector<Check> checks = check_machine(machine);
  checks.push_back(check_usb_cameras(machine.config));
  const std::vector<JitterRow> rows = measure_jitter(machine.config, options.seconds);
  if (options.json)
    print_json(checks, rows);
  else
    print_text(checks, rows);
}

}  // namespace

void add_doctor(CLI::App& app) {
  auto options = std::make_shared<DoctorOptions>();
  CLI::App* doctor = app.add_subcommand(
      "doctor", "Whether this machine is ready for real time, and how to make it so");
  doctor->add_option("--config", options->config,
                     "configuration (TOML) of the daemon that is to run");
  doctor
      ->add_option("--seconds", options->seconds,
                   "how long to measure wake-up jitter at each priority, s; 0: not at all")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  doctor->add_flag("--json", options->json, "print JSON");
  doctor->callback([options] { examine(*options); });
}

}  // namespace curlew
