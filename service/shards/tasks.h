// Tasks that do not wait for each other, on the CPUs of this process.
#pragma once

#include <functional>
#include <vector>

namespace curlew {

using Tasks = std::vector<std::function<void()>>;

/// Does all tasks, begun in their order, this thread among others: one for each CPU that this
/// process may use, and at most kMostTaskThreads. Throws what the first task that failed threw,
/// when none runs any more; tasks that were not begun then are left.
void do_tasks(const Tasks& tasks);
inline constexpr int kMostTaskThreads = 8;

}  // namespace curlew
