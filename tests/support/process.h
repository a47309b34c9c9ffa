// A Process is a program that runs beside the test.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace curlew {

class Process {
 public:
  /// Starts the program. Its output goes to the files out_path and err_path. before_exec runs in
  /// the child.
  Process(const std::vector<std::string>& command, const std::string& out_path,
          const std::string& err_path, void (*before_exec)() = nullptr)
      : out_path_(out_path), err_path_(err_path) {
    std::vector<char*> arguments;
    for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    pid_ = fork();
    if (pid_ != 0) return;
    const auto redirect = [](const std::string& path, int to) {
      const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
      dup2(fd, to);
      close(fd);
    };
    redirect(out_path, STDOUT_FILENO);
    redirect(err_path, STDERR_FILENO);
    if (before_exec != nullptr) before_exec();
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  ~Process() {
    if (!running()) return;
    ::kill(pid_, SIGKILL);
    waitpid(pid_, &status_, 0);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t pid() const { return pid_; }
  void signal(int number) const { ::kill(pid_, number); }

  bool running() {
    if (!ended_ && waitpid(pid_, &status_, WNOHANG) == pid_) ended_ = true;
    return !ended_;
  }
  /// Returns the exit code, 128 + signal if one ended it, or −1 if it still runs after the time.
  int wait(std::chrono::seconds longest) {
    const auto until = std::chrono::steady_clock::now() + longest;
    while (running() && std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (!ended_) return -1;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_);
  }
  std::string out() const { return text_of(out_path_); }
  std::string err() const { return text_of(err_path_); }

  /// Waits until its standard error, or output, holds the text. Returns false if it does not in
  /// time.
  bool says(const std::string& text, std::chrono::seconds longest) {
    const auto until = std::chrono::steady_clock::now() + longest;
    while (std::chrono::steady_clock::now() < until) {
      if (err().find(text) != std::string::npos || out().find(text) != std::string::npos)
        return true;
      if (!running()) return err().find(text) != std::string::npos;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

  /// Waits until the program catches the signal, which it does not from its very start. Returns
  /// false if it does not in time.
  bool catches(int number, std::chrono::seconds longest) const {
    const auto until = std::chrono::steady_clock::now() + longest;
    while (std::chrono::steady_clock::now() < until) {
      const std::string caught = status_line("SigCgt:");
      if (!caught.empty() && ((std::stoull(caught, nullptr, 16) >> (number - 1)) & 1U) != 0)
        return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }

  int threads() const { return entries("task"); }
  int open_files() const { return entries("fd"); }
  /// Returns the resident memory, in kB.
  long memory_kb() const {
    const std::string resident = status_line("VmRSS:");
    return resident.empty() ? 0 : std::stol(resident);
  }

 private:
  /// Returns what follows the key in /proc/PID/status; empty where there is no such line.
  std::string status_line(const std::string& key) const {
    std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
    for (std::string line; std::getline(status, line);)
      if (line.rfind(key, 0) == 0) return line.substr(key.size());
    return {};
  }
  static std::string text_of(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }
  int entries(const char* of) const {
    int count = 0;
    std::error_code gone;
    for (const auto& entry :
         std::filesystem::directory_iterator("/proc/" + std::to_string(pid_) + "/" + of, gone)) {
      static_cast<void>(entry);
      ++count;
    }
    return count;
  }

  std::string out_path_;
  std::string err_path_;
  pid_t pid_ = -1;
  int status_ = 0;
  bool ended_ = false;
};

}  // namespace curlew
