// A polite thread leaves the CPU to the threads of the frame path.
#pragma once

namespace curlew {

/// Names the calling thread (15 characters at most) and makes it an ordinary one that yields to the
/// others, even where a real-time thread began it.
void become_polite(const char* name) noexcept;

}  // namespace curlew
