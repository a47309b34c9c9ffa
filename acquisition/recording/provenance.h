// What a file says of where it comes from.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"

namespace curlew {

struct Provenance {
  // A name and version alone are a provenance, too.
  Provenance(std::string by) : program(std::move(by)) {}  // NOLINT(google-explicit-constructor)
  Provenance(const char* by) : program(by) {}             // NOLINT(google-explicit-constructor)

  std::string program;               ///< name and version: CREATOR
  std::int64_t observed_ns = 0;      ///< UTC of the first frame: DATE-OBS; 0 where it is not known
  std::string configuration_hash;    ///< CONFHASH; empty: none
  std::string sensor_hash;           ///< SENSHASH; empty: none
  std::optional<std::int64_t> seed;  ///< SEED, of simulated frames
  std::vector<std::string> history;  ///< HISTORY, line by line: the configuration, say

  bool operator==(const Provenance&) const = default;
};

/// Writes the keys into the selected header; what is not known is left out.
void write_provenance(FitsFile& file, const Provenance& provenance);

/// Returns what write_provenance() wrote. program: who writes what is made of it.
Provenance read_provenance(FitsFile& file, const std::string& program);

/// Returns the UTC that DATE-OBS of the selected header says, in ns since 1970; 0 where it says
/// none in the form of utc_text().
std::int64_t observed_ns(FitsFile& file);

/// Returns UTC as FITS has it: 2026-11-23T04:15:00.123.
std::string utc_text(std::int64_t utc_ns);

/// Returns the lines of a text.
std::vector<std::string> lines_of(const std::string& text);

}  // namespace curlew
