#include "service/shards/tasks.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>

#include "core/as_size.h"
#include "service/realtime/realtime.h"

namespace curlew {

void do_tasks(const Tasks& tasks) {
  std::atomic<std::size_t> next{0};
  std::mutex failing;
  std::exception_ptr failure;
  const auto work = [&] {
    for (std::size_t i = next++; i < tasks.size(); i = next++) {
      try {
        tasks[i]();
      } catch (...) {
        const std::lock_guard lock(failing);
        if (!failure) failure = std::current_exception();
        next = tasks.size();
      }
    }
  };
  {
    std::vector<std::jthread> others;
    const std::size_t threads =
        std::min(tasks.size(), as_size(std::min(usable_cpus(), kMostTaskThreads)));
    while (others.size() + 1 < threads) others.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace curlew
