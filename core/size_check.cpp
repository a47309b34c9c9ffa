#include "core/size_check.h"

#include <cstdio>
#include <cstdlib>

namespace curlew {

void end_for_size(const char* stage, const char* what, MapSize is, MapSize must_be) noexcept {
  std::fprintf(stderr,
               "curlew: %s was given %s of %d x %d where %d x %d is needed; this is a mistake in "
               "the program, please report it\n",
               stage, what, is.rows, is.cols, must_be.rows, must_be.cols);
  std::abort();
}

}  // namespace curlew
