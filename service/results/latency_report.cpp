#include "service/results/latency_report.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "service/program/version.h"

namespace curlew {
namespace {

constexpr std::array<std::pair<const char*, double>, 5> kPercentiles = {
    {{"p50", 0.5}, {"p90", 0.9}, {"p99", 0.99}, {"p99.9", 0.999}, {"max", 1.0}}};

template <typename Visitor>
void for_each_histogram(const RunReport& report, Visitor&& visit) {
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    visit(kStages[stage].name, report.stage[stage]);
  visit("publish", report.publish);
  visit("total", report.total);
}

double microseconds(const LatencyHistogram& histogram, double fraction) {
  return static_cast<double>(histogram.percentile_ns(fraction)) * 1e-3;
}

std::string cpu_model() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos)
      return line.substr(colon + 2);
  }
  return "unknown";
}

}  // namespace

std::string latency_table(const RunReport& report) {
  std::string text = fmt::format("{:<10}", "µs");
  text += ' ';  // the width counts bytes, and µ has two
  for (const auto& [name, fraction] : kPercentiles) text += fmt::format("{:>10}", name);
  text += '\n';
  for_each_histogram(report, [&](const char* name, const LatencyHistogram& histogram) {
    text += fmt::format("{:<10}", name);
    for (const auto& [percentile, fraction] : kPercentiles)
      text += fmt::format("{:>10.1f}", microseconds(histogram, fraction));
    text += '\n';
  });
  return text;
}

nlohmann::ordered_json latency_json(const RunReport& report) {
  nlohmann::ordered_json json;
  for_each_histogram(report, [&](const char* name, const LatencyHistogram& histogram) {
    for (const auto& [percentile, fraction] : kPercentiles)
      json[name][percentile] = microseconds(histogram, fraction);
  });
  return json;
}

nlohmann::ordered_json machine_json() {
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["build"] = kBuildType;
  json["compiler"] = kCompiler;
  json["cpu"] = cpu_model();
  json["cpus"] = std::thread::hardware_concurrency();
  return json;
}

std::string machine_text() {
  return fmt::format("{}, {} build, {}\n{}, {} CPUs\n", kProgram, kBuildType, kCompiler,
                     cpu_model(), std::thread::hardware_concurrency());
}

}  // namespace curlew
