#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/daemon/control_socket.h"
#include "service/program/outputs.h"

namespace curlew {
namespace {

struct Question {
  std::string word;
  std::string socket = "/run/curlew/control";
  std::string out;
  Existing existing = Existing::kRefused;
};

void write_whole(const std::string& path, const std::string& bytes) {
  const std::string target = replaceable_target(path);
  const std::string partial = partial_path(target);
  std::error_code error;
  std::ofstream file(partial, std::ios::binary);
  file << bytes;
  file.close();
  if (file) std::filesystem::rename(partial, target, error);
  if (file && !error) return;
  std::error_code ignored;
  std::filesystem::remove(partial, ignored);
  throw Failure(path + " cannot be written; is the folder there, with room and rights?");
}

void control(const Question& question) {
  const bool file = question.word == "snapshot";
  if (file && question.out.empty())
    throw UsageError("a snapshot goes into a file: name one with --out");
  if (!file && !question.out.empty())
    throw UsageError("--out is for snapshot; '" + question.word + "' is answered in text");
  check_output(question.out, {}, question.existing);
  const std::string answer = ask_daemon(question.socket, question.word);
  if (answer.rfind("error: ", 0) == 0) throw Failure(answer.substr(7));
  if (file)
    write_whole(question.out, answer);
  else
    fmt::print("{}{}", answer, answer.back() == '\n' ? "" : "\n");
}

}  // namespace

void add_control(CLI::App& app) {
  auto question = std::make_shared<Question>();
  CLI::App* command = app.add_subcommand("control", "Ask or tell the running daemon");
  command
      ->add_option("word", question->word,
                   "command: status (JSON), metrics (as Prometheus has them), snapshot (the next "
                   "frame with its results, into --out), trigger (the recorder) or expose (a "
                   "software-triggered camera)")
      ->required();
  command->add_option("--out", question->out, "results file for the snapshot (FITS)");
  add_force_flag(*command, question->existing);
  command
      ->add_option("--socket", question->socket,
                   "socket of the daemon: control in section [daemon]")
      ->capture_default_str();
  command->callback([question] { control(*question); });
}

}  // namespace curlew
