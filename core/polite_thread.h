// A polite thread leaves the CPU to the threads of the frame path.
#pragma once

namespace curlew {

/// Names the calling thread (15 characters at most) and makes it an ordinary one that yields to the
/// others, even where a real-time thread began it. The nicest, 19, still gets a hundredth of a CPU
/// that others want, so that its work does not pile up for ever.
void become_polite(const char* name, int nice = 5) noexcept;

}  // namespace curlew
