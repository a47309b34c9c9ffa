#include "service/watch/terminal_watch.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "core/error.h"
#include "service/watch/terminal_picture.h"

namespace curlew {
namespace {

/// Returns how many columns a pane may have, so that three of them and the lines below fit.
int pane_cols() {
  constexpr int kBelow = 5;
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 24;
  return std::max(8, std::min((size.ws_col - 6) / 3, 2 * (size.ws_row - kBelow)));
}

void put(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stdout);
  std::fflush(stdout);
}

}  // namespace

TerminalWatch::TerminalWatch() {
  if (isatty(STDOUT_FILENO) == 0)
    throw UsageError("--watch needs a terminal; take [page] listen to look from elsewhere");
  put("\x1b[?1049h\x1b[?25l\x1b[2J");  // the other screen, without a cursor, cleared
  tap_.ask();
}

TerminalWatch::~TerminalWatch() { put("\x1b[?25h\x1b[?1049l"); }

void TerminalWatch::draw(const std::vector<std::string>& lines) {
  if (const FrameCopy* copy = tap_.answer(); copy != nullptr) {
    picture_ = terminal_picture(*copy, pane_cols());
    tap_.ask();
  }
  std::string text = "\x1b[H" + picture_;
  for (const std::string& line : lines) text += line + "\x1b[K\n";
  put(text + "\x1b[J");
}

}  // namespace curlew
