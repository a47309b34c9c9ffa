#include "service/bench/bench_run.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <thread>

#include "core/error.h"
#include "service/program/interrupt.h"

namespace curlew {

void BenchRun::add_to(CLI::App& command, const std::string& quick_text, int& threads) {
  threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  command.add_flag("--quick", quick, quick_text);
  command.add_option("--cache", cache, "folder in which simulated fields are kept")
      ->capture_default_str();
  command.add_flag("--no-cache", no_cache, "do not keep simulated fields");
  command.add_option("--threads", threads, "number of threads")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_flag("--json", json, "print JSON");
}

void BenchRun::check_interrupt() const {
  if (!interrupted()) return;
  throw Failure(folder().empty()
                    ? "interrupted"
                    : "interrupted; what was simulated is kept, so run it again to go on");
}

void refuse_debug_build() {
#ifndef NDEBUG
  throw Failure("a debug build's times mean nothing and take too long, build with './dev build'");
#endif
}

}  // namespace curlew
