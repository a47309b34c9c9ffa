#include "acquisition/pictures/picture_stack.h"

#include <glob.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "core/error.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

bool has_picture_suffix(const fs::path& path) {
  constexpr std::array<std::string_view, 4> kSuffixes = {".png", ".tif", ".tiff", ".npy"};
  std::string suffix = path.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::find(kSuffixes.begin(), kSuffixes.end(), suffix) != kSuffixes.end();
}

bool is_pattern(const std::string& path) {
  std::error_code none;
  return !fs::exists(path, none) && path.find_first_of("*?") != std::string::npos;
}

std::vector<std::string> match(const std::string& pattern) {
  glob_t found{};
  std::vector<std::string> paths;
  // What is not thread safe of glob() is the expansion of ~user, which is not asked for.
  if (glob(pattern.c_str(), 0, nullptr, &found) == 0)  // NOLINT(concurrency-mt-unsafe)
    paths.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  globfree(&found);
  return paths;
}

std::string text_of(const PictureFormat& format) {
  return std::to_string(format.frames) + " of " + std::to_string(format.rows) + " x " +
         std::to_string(format.cols) + " pixels of " +
         std::to_string(8 * bytes_of(format.element)) + " bits";
}

}  // namespace

bool comes_before(const std::string& a, const std::string& b) {
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
      continue;
    }
    const auto take_number = [](const std::string& text, std::size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const std::size_t begin = at;
      while (at < text.size() && is_digit(text[at])) ++at;
      return std::string_view(text).substr(begin, at - begin);
    };
    const std::string_view x = take_number(a, i);
    const std::string_view y = take_number(b, j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;  // as "a01" and "a1"
}

bool means_pictures(const std::string& path) {
  std::error_code none;
  if (fs::is_directory(path, none) || is_pattern(path)) return true;
  return fs::is_regular_file(path, none) && is_picture_file(path);
}

std::vector<std::string> find_pictures(const std::string& path) {
  std::error_code error;
  std::vector<std::string> paths;
  if (fs::is_directory(path, error)) {
    for (fs::directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error))
      if (has_picture_suffix(entry->path())) paths.push_back(entry->path().string());
    if (paths.empty()) {
      throw Failure(path +
                    " is a directory without PNG, TIFF or npy files: name a file, or a directory "
                    "with a sequence of pictures");
    }
  } else if (is_pattern(path)) {
    paths = match(path);
    if (paths.empty()) throw Failure("no file is called as " + path + " says");
  } else {
    paths.push_back(path);
  }
  std::sort(paths.begin(), paths.end(), comes_before);
  return paths;
}

PictureStack::PictureStack(const std::string& path) : paths_(find_pictures(path)) {
  for (const std::string& one : paths_) {
    if (!is_picture_file(one)) {
      throw Failure(one + " is neither PNG nor TIFF nor npy, as the pictures of a sequence must " +
                    "be; FITS files are named one by one");
    }
    const std::unique_ptr<PictureFile> file = open_picture_file(one);
    if (&one == &paths_.front()) format_ = file->format();
    if (file->format() != format_) {
      throw Failure(one + " has frames: " + text_of(file->format()) + ", and " + paths_.front() +
                    " " + text_of(format_) + ": the pictures of a sequence must be alike");
    }
  }
  frames_of_file_ = format_.frames;
  format_.frames *= static_cast<std::int64_t>(paths_.size());
}

void PictureStack::load(std::int64_t frame) {
  if (frame == loaded_) return;
  const auto index = static_cast<std::size_t>(frame / frames_of_file_);
  if (!file_ || index != file_index_) {
    file_ = open_picture_file(paths_[index]);
    file_index_ = index;
    PictureFormat format = file_->format();
    format.frames = format_.frames;
    if (format != format_ || file_->format().frames != frames_of_file_)
      throw Failure(paths_[index] + " has changed while it was read");
  }
  pixels_.resize(format_.pixels() * bytes_of(format_.element));
  loaded_ = -1;
  file_->read(frame % frames_of_file_, pixels_);
  loaded_ = frame;
}

}  // namespace curlew
