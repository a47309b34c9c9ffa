#include "acquisition/recording/provenance.h"

#include <spdlog/fmt/fmt.h>

#include <ctime>
#include <sstream>

#include "core/error.h"

namespace curlew {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

/// Returns nanoseconds since 1970; 0 where the text is no time of ours.
std::int64_t utc_ns_of(const std::string& text) {
  std::tm utc{};
  int milliseconds = 0;
  std::istringstream stream(text);
  char unit[5] = {};
  stream >> utc.tm_year >> unit[0] >> utc.tm_mon >> unit[1] >> utc.tm_mday >> unit[2] >>
      utc.tm_hour >> unit[3] >> utc.tm_min >> unit[4] >> utc.tm_sec;
  if (!stream) return 0;
  if (stream.get() == '.') stream >> milliseconds;
  utc.tm_year -= 1900;
  utc.tm_mon -= 1;
  return timegm(&utc) * kNsPerS + std::int64_t{milliseconds} * 1'000'000;
}

}  // namespace

std::string utc_text(std::int64_t utc_ns) {
  const std::time_t seconds = utc_ns / kNsPerS;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}", utc.tm_year + 1900,
                     utc.tm_mon + 1, utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec,
                     utc_ns / 1'000'000 % 1000);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

void write_provenance(FitsFile& file, const Provenance& provenance) {
  file.write_key("CREATOR", provenance.program, "program that wrote this file");
  if (provenance.observed_ns > 0)
    file.write_key("DATE-OBS", utc_text(provenance.observed_ns), "UTC of the first frame");
  if (!provenance.configuration_hash.empty())
    file.write_key("CONFHASH", provenance.configuration_hash, "hash of the configuration");
  if (!provenance.sensor_hash.empty())
    file.write_key("SENSHASH", provenance.sensor_hash, "hash of the sensor file's content");
  if (provenance.seed) file.write_key("SEED", *provenance.seed, "of the simulated frames");
  for (const std::string& line : provenance.history) file.write_history(line);
}

std::int64_t observed_ns(FitsFile& file) {
  try {
    return utc_ns_of(file.key_string("DATE-OBS").value_or(""));
  } catch (const Failure&) {
    return 0;  // It is no text.
  }
}

Provenance read_provenance(FitsFile& file, const std::string& program) {
  Provenance provenance(program);
  provenance.observed_ns = curlew::observed_ns(file);
  provenance.configuration_hash = file.key_string("CONFHASH").value_or("");
  provenance.sensor_hash = file.key_string("SENSHASH").value_or("");
  provenance.seed = file.key_int("SEED");
  provenance.history = file.history();
  return provenance;
}

}  // namespace curlew
