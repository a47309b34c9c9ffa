// The environment in which one call of a program fails; failing_calls.cpp makes it fail.
#pragma once

#include <string>

#include "tests/support/paths.h"

namespace curlew {

/// Returns the assignments for a shell or for env: the at-th call (from 1) of `call` on a path that
/// contains `path` fails with this error number, and the file `mark` is then made. For sockets and
/// poll() the path is empty. error 0: it takes half of the bytes.
inline std::string failing_call(const std::string& call, int error, int at, const std::string& path,
                                const std::string& mark) {
  return std::string("ASAN_OPTIONS=verify_asan_link_order=0 LD_PRELOAD=") + kFailingCalls +
         " CURLEW_FAIL_CALL=" + call + " CURLEW_FAIL_AT=" + std::to_string(at) +
         " CURLEW_FAIL_PATH=" + path + " CURLEW_FAIL_WITH=" + std::to_string(error) +
         " CURLEW_FAIL_MARK=" + mark + " ";
}

}  // namespace curlew
