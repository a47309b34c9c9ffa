// A Team lets threads that have nothing to do help another with a loop.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace curlew {

/// Threads of one team share loops of independent pieces, and wait for each other. It is lock-free
/// and never allocates. A wait spins for a bounded time, anew after each loop that was shared, and
/// then parks, because the kernel stops a real-time thread that spins for ever.
class Team {
 public:
  Team() = default;
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  /// The end of the loop from which a thread takes pieces. Threads that keep to their ends find
  /// what the pieces need in their own caches, loop after loop.
  enum class Side : std::uint8_t { kFront, kBack };

  /// Calls work(i) once for each i of [0, n) and returns when all of them are done. Threads that
  /// wait for something in wait_until() take some of the pieces. One thread at a time may share;
  /// n is at most 4000.
  template <typename Work>
  void share(int n, const Work& work) noexcept {
    work_ = &work;
    call_ = [](const void* shared, int i) { (*static_cast<const Work*>(shared))(i); };
    done_.store(0, std::memory_order_relaxed);
    const std::uint64_t round = round_of(ticket_.load(std::memory_order_relaxed)) + 1;
    ticket_.store(round << kRoundBit | static_cast<std::uint64_t>(n) << kCountBit,
                  std::memory_order_release);
    ring();
    while (help(leading_side_)) continue;
    wait_for_all(n);
  }

  /// Says from which side the thread takes pieces that shares the next loops.
  void lead_from(Side side) noexcept { leading_side_ = side; }

  /// Does one piece of a loop that is being shared. Returns false if there is none left.
  bool help(Side side) noexcept {
    if (!has_piece(ticket_.load(std::memory_order_relaxed))) return false;
    const std::uint64_t one = side == Side::kFront ? 1 : std::uint64_t{1} << kBackBit;
    const std::uint64_t ticket = ticket_.fetch_add(one, std::memory_order_acq_rel);
    if (!has_piece(ticket)) return false;
    // The loop cannot end, nor another one begin, before this piece is done.
    const int n = count_of(ticket);
    call_(work_, side == Side::kFront ? front_of(ticket) : n - 1 - back_of(ticket));
    if (done_.fetch_add(1, std::memory_order_acq_rel) + 1 == n) done_.notify_all();
    return true;
  }

  /// Says that something has changed for which a thread may be waiting.
  void ring() noexcept {
    bell_.fetch_add(1, std::memory_order_acq_rel);
    bell_.notify_all();
  }

  /// Waits until condition() is true, and meanwhile helps from that side of shared loops. Whoever
  /// makes the condition true must ring.
  template <typename Condition>
  void wait_until(const Condition& condition, Side side = Side::kBack) noexcept {
    int spins = kSpins;
    std::uint64_t round = round_of(ticket_.load(std::memory_order_relaxed));
    while (true) {
      const std::uint32_t bell = bell_.load(std::memory_order_acquire);
      // A loop that was missed is followed by others of the same frame.
      const std::uint64_t now = round_of(ticket_.load(std::memory_order_relaxed));
      if (now != round) spins = kSpins;
      round = now;
      do {
        if (condition()) return;
        if (help(side)) spins = kSpins;
        relax();
        spins = std::max(spins - 1, 0);
      } while (spins > 0);
      bell_.wait(bell, std::memory_order_acquire);
    }
  }

 private:
  // A ticket is the number of the loop, how many pieces it has, and how many of them have been
  // taken from either side.
  static constexpr int kBackBit = 12;
  static constexpr int kCountBit = 24;
  static constexpr int kRoundBit = 40;
  // Some 100 to 300 µs. Whoever parks within a frame costs the others more than that takes.
  static constexpr int kSpins = 100'000;

  static std::uint64_t round_of(std::uint64_t ticket) noexcept { return ticket >> kRoundBit; }
  static int part_of(std::uint64_t ticket, int bit, int bits) noexcept {
    return static_cast<int>(ticket >> bit & ((std::uint64_t{1} << bits) - 1));
  }
  static int front_of(std::uint64_t ticket) noexcept { return part_of(ticket, 0, kBackBit); }
  static int back_of(std::uint64_t ticket) noexcept {
    return part_of(ticket, kBackBit, kCountBit - kBackBit);
  }
  static int count_of(std::uint64_t ticket) noexcept {
    return part_of(ticket, kCountBit, kRoundBit - kCountBit);
  }
  static bool has_piece(std::uint64_t ticket) noexcept {
    return front_of(ticket) + back_of(ticket) < count_of(ticket);
  }
  /// Keeps a loop that waits from being optimised away. A pause instruction would have a virtual
  /// machine stop the processor.
  static void relax() noexcept { std::atomic_signal_fence(std::memory_order_acquire); }

  void wait_for_all(int n) noexcept {
    for (int spins = 0; spins < kSpins; ++spins) {
      if (done_.load(std::memory_order_acquire) == n) return;
      relax();
    }
    for (int done = done_.load(std::memory_order_acquire); done != n;
         done = done_.load(std::memory_order_acquire))
      done_.wait(done, std::memory_order_acquire);
  }

  static constexpr std::size_t kCacheLine = 64;
  alignas(kCacheLine) std::atomic<int> done_{0};
  Side leading_side_ = Side::kFront;
  // Written before a ticket is handed out, read by those who got one.
  const void* work_ = nullptr;
  void (*call_)(const void*, int) = nullptr;
  alignas(kCacheLine) std::atomic<std::uint32_t> bell_{0};
  alignas(kCacheLine) std::atomic<std::uint64_t> ticket_{0};
};

/// Into so many pieces share_rows() cuts a loop: enough for four threads of unequal speed.
inline constexpr int kTeamPieces = 8;

/// Calls work(piece, begin, end) for pieces of rows [first, last): for all of them at once, or with
/// a team, where there are at least twice as many rows, for kTeamPieces pieces in any order.
template <typename Work>
void share_rows(Team* team, int first, int last, const Work& work) noexcept {
  const int rows = last - first;
  if (team == nullptr || rows < 2 * kTeamPieces) {
    if (rows > 0) work(0, first, last);
    return;
  }
  team->share(kTeamPieces, [&](int piece) {
    work(piece, first + rows * piece / kTeamPieces, first + rows * (piece + 1) / kTeamPieces);
  });
}

}  // namespace curlew
