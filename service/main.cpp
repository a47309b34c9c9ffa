#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <new>
#include <string>

#include "acquisition/fits/unpacking_process.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/program/interrupt.h"
#include "service/program/outputs.h"
#include "service/program/version.h"

namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;

bool is_command(const CLI::App& app, const std::string& word) {
  const auto commands = app.get_subcommands([&](const CLI::App* c) { return c->check_name(word); });
  return !commands.empty();
}

int complain(const std::exception& error, int exit_code) {
  std::fflush(stdout);
  curlew::complain(error.what());
  return exit_code;
}

/// Runs the command that the arguments name. --help and --version only print.
int run(int argc, char** argv) {
  CLI::App app{"Curlew: wavefronts and optical vortices from a Shack-Hartmann sensor", "curlew"};
  app.set_version_flag("--version", curlew::kProgram);
  app.require_subcommand(1);
  curlew::add_simulate(app);
  curlew::add_calibrate(app);
  curlew::add_replay(app);
  curlew::add_merge(app);
  curlew::add_run(app);
  curlew::add_control(app);
  curlew::add_bench(app);
  curlew::add_cameras(app);
  curlew::add_doctor(app);
  curlew::add_kernel(app);
  curlew::add_convert(app);
  curlew::add_export(app);
  if (argc > 1 && argv[1][0] != '-' && !is_command(app, argv[1]))
    throw curlew::UsageError("there is no command '" + std::string(argv[1]) +
                             "', see curlew --help");
  try {
    curlew::catch_signals();
    app.parse(argc, argv);
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
      throw curlew::Failure("standard output cannot be written");
    return 0;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0) throw;
    return app.exit(error);  // it was --help or --version
  }
}

}  // namespace

int main(int argc, char** argv) {
  curlew::fill_standard_descriptors();
  curlew::serve_unpacking_if_asked(argc, argv);
  curlew::make_standard_output_interruptible();
  try {
    return run(argc, argv);
  } catch (const CLI::ParseError& error) {
    return complain(error, kExitUsage);
  } catch (const curlew::UsageError& error) {
    return complain(error, kExitUsage);
  } catch (const std::bad_alloc&) {
    curlew::complain("out of memory; use smaller frames or fewer slots");
    return kExitFailure;
  } catch (const std::exception& error) {
    return complain(error, kExitFailure);
  }
}
