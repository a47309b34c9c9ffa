#include "service/program/stream_writing.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <string>
#include <string_view>
#include <thread>

namespace curlew {
namespace {

/// A pipe that has no room left.
class FullPipe {
 public:
  FullPipe() {
    EXPECT_EQ(pipe2(ends_.data(), O_NONBLOCK), 0);
    const std::string bytes(4096, '.');
    while (write(ends_[1], bytes.data(), bytes.size()) > 0) {
    }
  }
  ~FullPipe() {
    close(ends_[0]);
    close(ends_[1]);
  }
  FullPipe(const FullPipe&) = delete;
  FullPipe& operator=(const FullPipe&) = delete;

  int reading_end() const { return ends_[0]; }
  int writing_end() const { return ends_[1]; }

 private:
  std::array<int, 2> ends_{};
};

// The signal's handler reads from the pipe, so that there is room as soon as the wait is
// interrupted.
int g_read_on_signal = -1;
volatile sig_atomic_t g_interrupted = 0;
void interrupt_and_read(int) {
  g_interrupted = 1;
  std::array<char, 16384> bytes{};
  [[maybe_unused]] const ssize_t count = read(g_read_on_signal, bytes.data(), bytes.size());
}

TEST(StreamWriting, ASignalDuringTheWaitLosesNoText) {
  const FullPipe pipe;
  g_read_on_signal = pipe.reading_end();
  struct sigaction reads {};
  reads.sa_handler = interrupt_and_read;
  struct sigaction before {};
  ASSERT_EQ(sigaction(SIGUSR1, &reads, &before), 0);
  const pthread_t writer = pthread_self();
  std::thread signaller([writer] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    pthread_kill(writer, SIGUSR1);
  });
  std::string_view text = "what is to be written";
  const int error = write_stream(pipe.writing_end(), text, [] { return g_interrupted != 0; });
  signaller.join();
  sigaction(SIGUSR1, &before, nullptr);
  EXPECT_EQ(error, 0);
  EXPECT_TRUE(text.empty()) << text;
}

TEST(StreamWriting, AReaderThatDoesNotReadIsGivenUpOnceItIsToStop) {
  const FullPipe pipe;
  std::string_view text = "nobody reads this";
  EXPECT_EQ(write_stream(pipe.writing_end(), text, [] { return true; }), EAGAIN);
  EXPECT_EQ(text, "nobody reads this");
}

}  // namespace
}  // namespace curlew
