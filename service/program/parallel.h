// Does the same work for many indices on several threads.
#pragma once

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace curlew {

/// Calls work(index, thread) once for every index in [0, n), in no particular order; thread is in
/// [0, threads). If a call throws, it ends early and throws what was thrown first.
template <typename Work>
void for_each_in_parallel(int n, int threads, Work work) {
  std::atomic<int> next{0};
  std::exception_ptr failure;
  std::mutex failing;
  const auto run = [&](int thread) {
    try {
      for (int index = next++; index < n; index = next++) work(index, thread);
    } catch (...) {
      const std::scoped_lock lock(failing);
      if (!failure) failure = std::current_exception();
      next = n;
    }
  };
  std::vector<std::thread> others;
  for (int thread = 1; thread < threads; ++thread) others.emplace_back(run, thread);
  run(0);
  for (std::thread& other : others) other.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace curlew
