// Loopback addresses for fake GigE Vision cameras, one camera each: their port is fixed.
#pragma once

namespace curlew {

/// How many of 127.0.0.1, 127.0.0.2, … this process, its threads and its children can use without
/// meeting anybody else. The first call gives the process a network of its own with 8 addresses
/// (Linux network namespace). Where the machine does not allow that there is one: the machine's own
/// 127.0.0.1, for which processes that ask here wait for each other. Call it before there are
/// threads.
int claim_loopback();

}  // namespace curlew
