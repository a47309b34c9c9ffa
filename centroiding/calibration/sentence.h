// say: a message from text and numbers, for failures and notes.
#pragma once

#include <sstream>
#include <string>

namespace curlew {

/// The parts one after another, numbers with five digits: say("a pitch of ", 6.0, " px").
template <typename... Parts>
std::string say(const Parts&... parts) {
  std::ostringstream text;
  text.precision(5);  // what 16 bits hold
  (text << ... << parts);
  return text.str();
}

}  // namespace curlew
