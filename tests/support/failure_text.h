// This catches the sentence of the error that a piece of code throws.
#pragma once

#include <string>

#include "core/error.h"

namespace curlew {

/// Returns what `act` threw as a Failure, or another Error; empty if it threw nothing. Other
/// exceptions pass.
template <typename Error = Failure, typename Act>
std::string failure_text(Act&& act) {
  try {
    act();
  } catch (const Error& error) {
    return error.what();
  }
  return {};
}

}  // namespace curlew
