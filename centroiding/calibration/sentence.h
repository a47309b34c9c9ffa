// say() makes a message of text and numbers, for failures and notes.
#pragma once

#include <sstream>
#include <string>

namespace curlew {

/// Joins the parts one after another and writes numbers with five digits: say("a pitch of ", 6.0, "
/// px").
template <typename... Parts>
std::string say(const Parts&... parts) {
  std::ostringstream text;
  text.precision(5);  // Five digits hold a 16-bit number.
  (text << ... << parts);
  return text.str();
}

}  // namespace curlew
