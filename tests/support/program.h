// This runs the curlew program as a user would.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include "tests/support/paths.h"
#include "tests/support/scratch_directory.h"

namespace curlew {

struct ProgramRun {
  int exit_code = -1;  ///< 128 + signal if it crashed
  std::string out;
  std::string err;
};

/// Runs `curlew <arguments>` by the shell in `directory`. prefix: shell text before the program.
inline ProgramRun run_curlew(const ScratchDirectory& directory, const std::string& arguments,
                             const std::string& prefix = "") {
  const ScratchDirectory streams;
  const std::string line = "cd '" + directory.path() + "' && " + prefix + " '" + kCurlewProgram +
                           "' " + arguments + " >'" + (streams / "out") + "' 2>'" +
                           (streams / "err") + "'";
  const int status = std::system(line.c_str());
  ProgramRun run;
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  run.out = read_bytes(streams / "out");
  run.err = read_bytes(streams / "err");
  return run;
}

}  // namespace curlew
