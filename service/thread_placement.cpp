#include "service/thread_placement.h"

#include <utility>

#include "service/realtime/realtime.h"

namespace curlew {

ThreadPlacement::ThreadPlacement(std::vector<int> cpus, int priority)
    : cpus_(std::move(cpus)), priority_(priority) {}

PipelineThreadStart ThreadPlacement::thread_start() {
  return [this](const std::string& name, std::size_t number) {
    std::vector<int> cpu;
    if (!cpus_.empty()) cpu.push_back(cpus_[number % cpus_.size()]);
    const std::vector<std::string> sentences = enter_realtime(name, cpu, priority_);
    const std::lock_guard lock(mutex_);
    refused_.insert(refused_.end(), sentences.begin(), sentences.end());
  };
}

std::vector<std::string> ThreadPlacement::refused() const {
  const std::lock_guard lock(mutex_);
  return refused_;
}

std::string ThreadPlacement::description() const {
  if (cpus_.empty()) return "none";
  std::string text = refused().empty() ? "cpu" : "refused by the system: cpu";
  for (const int cpu : cpus_) text.append(" ").append(std::to_string(cpu));
  return text;
}

}  // namespace curlew
