// A polite thread leaves the CPU to the threads of the frame path.
#pragma once

namespace curlew {

/// Names the calling thread (15 characters at most) and makes it an ordinary one that yields to the
/// others, even where a real-time thread began it. Beside one busy thread a nice of 5 gets a
/// quarter of a CPU and 10 a tenth. With 19 it is a hundredth, so that work piles up where more are
/// busy.
void become_polite(const char* name, int nice = 5) noexcept;

}  // namespace curlew
