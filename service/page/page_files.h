// The files of the page, as they lie in service/page/web. CMake puts them into the program.
#pragma once

#include <span>
#include <string_view>

namespace curlew {

struct PageFile {
  std::string_view name;  ///< as "page.css"
  std::string_view text;
};

/// Returns all files; modules come after those that they import.
std::span<const PageFile> page_files();

}  // namespace curlew
