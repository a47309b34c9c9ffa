// This claims loopback addresses for fake GigE Vision cameras. Each takes one camera, because the
// port of a camera is fixed.
#pragma once

namespace curlew {

/// Returns how many of 127.0.0.1, 127.0.0.2, … this process, its threads and its children can use
/// without meeting anybody else. The first call gives the process a network of its own with 8
/// addresses (Linux network namespace). If the machine does not allow that, there is one address,
/// the machine's own 127.0.0.1, for which processes that ask here wait for each other. Call it
/// before there are threads.
int claim_loopback();

}  // namespace curlew
