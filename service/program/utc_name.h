// This file declares how a time stands in the name of a file.
#pragma once

#include <spdlog/fmt/fmt.h>

#include <cstdint>
#include <ctime>
#include <string>

namespace curlew {

/// Returns a UTC time in ns since 1970 as "20261123T041500.123Z".
inline std::string utc_name(std::int64_t utc_ns) {
  const std::time_t seconds = utc_ns / 1'000'000'000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  return fmt::format("{:04}{:02}{:02}T{:02}{:02}{:02}.{:03}Z", utc.tm_year + 1900, utc.tm_mon + 1,
                     utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec, utc_ns / 1'000'000 % 1000);
}

}  // namespace curlew
