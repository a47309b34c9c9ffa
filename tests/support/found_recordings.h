// This reads what astropy finds in recordings of numbered frames.
#pragma once

#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/astropy_peer.h"

namespace curlew {

struct FoundRecording {
  std::string name;           ///< path relative to the directory asked for
  std::int64_t frames = 0;    ///< frames of the cube
  std::int64_t rows = 0;      ///< rows of FRAMES; −1 if there is none
  std::int64_t first = 0;     ///< first sequence; counted from 0 if there is no table
  std::int64_t last = 0;      ///< sequence of the cube's last frame
  std::int64_t wrong = 0;     ///< frames with a pixel that is not as numbered
  std::int64_t warnings = 0;  ///< warnings of astropy, if there is a table
};

/// Reads an answer of ask_astropy("recordings", …).
inline std::vector<FoundRecording> found_recordings(const PeerAnswer& answer) {
  std::vector<FoundRecording> all;
  std::istringstream lines(answer.text);
  std::string word;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    FoundRecording r;
    words >> word >> r.name >> word >> r.frames >> word >> r.rows >> word >> r.first >> word >>
        r.last >> word >> r.wrong >> word >> r.warnings;
    if (words && line.starts_with("recording ")) all.push_back(r);
  }
  return all;
}

}  // namespace curlew
