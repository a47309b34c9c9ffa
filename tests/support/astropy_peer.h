// This runs tests/support/astropy_peer.py, a reader and writer of FITS independent of cfitsio.
#pragma once

#include <stdio.h>
#include <sys/wait.h>

#include <array>
#include <string>

#include "tests/support/paths.h"

namespace curlew {

struct PeerAnswer {
  int exit_code = -1;  ///< 77 if astropy is not installed
  std::string text;    ///< what it printed, errors included
};

/// Runs a command: "describe", "recordings" or "write". path: a file or a directory without quotes
/// in its name.
inline PeerAnswer ask_astropy(const std::string& command, const std::string& path) {
  const std::string line = std::string("/usr/bin/python3 '") + kSourceDir +
                           "/tests/support/astropy_peer.py' " + command + " '" + path + "' 2>&1";
  PeerAnswer answer;
  FILE* pipe = popen(line.c_str(), "r");
  if (pipe == nullptr) return answer;
  std::array<char, 4096> block{};
  for (size_t n = 0; (n = fread(block.data(), 1, block.size(), pipe)) > 0;) {
    answer.text.append(block.data(), n);
  }
  const int status = pclose(pipe);
  answer.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (answer.exit_code == 127) answer.exit_code = 77;  // There is no python at all.
  return answer;
}

}  // namespace curlew
