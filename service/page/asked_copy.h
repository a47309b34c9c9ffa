// AskedCopy lets one thread have a copy of what passes in another, when it asks for one.
#pragma once

#include <atomic>

namespace curlew {

/// One copy goes to and fro: either thread owns it in turn, and neither waits for the other. `Copy`
/// has copy(…), which copies without allocating or returns false where its buffers have other
/// sizes, and fit(), which then makes buffers of those sizes.
template <typename Copy>
class AskedCopy {
 public:
  /// The thread in which things pass calls this for each. It never waits, locks or allocates.
  template <typename... From>
  void offer(const From&... from) noexcept {
    if (!asked_.load(std::memory_order_acquire)) return;
    fits_ = copy_.copy(from...);
    asked_.store(false, std::memory_order_release);
  }

  /// The other thread calls this: returns what passed since the last ask(), or null while nothing
  /// has. The copy is this thread's until the next ask().
  const Copy* answer() {
    if (!asked_once_ || asked_.load(std::memory_order_acquire)) return nullptr;
    if (fits_) return &copy_;
    copy_.fit();
    ask();
    return nullptr;
  }
  /// The other thread calls this, and not again before answer() has returned a copy.
  void ask() {
    asked_once_ = true;
    asked_.store(true, std::memory_order_release);
  }

 private:
  std::atomic<bool> asked_{false};  ///< the copy belongs to the thread in which things pass
  bool asked_once_ = false;         ///< only the other thread touches it
  bool fits_ = false;               ///< who owns the copy owns this
  Copy copy_;
};

}  // namespace curlew
