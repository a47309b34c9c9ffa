// The flag --page, which every command with a live page has.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace curlew {

/// Adds --page [ADDRESS:PORT]. `listen` stays as it is where the flag is not given.
inline void add_page_flag(CLI::App& command, std::string& listen) {
  command
      .add_option("--page", listen,
                  "show the frames as a page in the browser, at ADDRESS:PORT (default "
                  "127.0.0.1:8080), until the program ends")
      ->expected(0, 1)
      ->default_str("127.0.0.1:8080");
}

}  // namespace curlew
