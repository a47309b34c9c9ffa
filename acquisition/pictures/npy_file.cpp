#include "acquisition/pictures/npy_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <system_error>
#include <vector>

#include "core/error.h"
#include "core/printable.h"

namespace curlew {
namespace {

/// Returns what follows `'key':` in the header's dictionary, blanks skipped; empty if it is not
/// there.
std::string_view value_of(std::string_view header, std::string_view key) {
  const std::string quoted = std::string("'").append(key).append("'");
  std::size_t at = header.find(quoted);
  if (at == std::string_view::npos) return {};
  at = header.find(':', at + quoted.size());
  if (at == std::string_view::npos) return {};
  at = header.find_first_not_of(" \t\n", at + 1);
  return at == std::string_view::npos ? std::string_view{} : header.substr(at);
}

/// Reads "(2, 3, 4)". Returns nothing where it is no list of numbers.
std::optional<std::vector<std::int64_t>> read_shape(std::string_view text) {
  const std::size_t end = text.find(')');
  if (!text.starts_with('(') || end == std::string_view::npos) return std::nullopt;
  text = text.substr(1, end - 1);
  std::vector<std::int64_t> shape;
  while (true) {
    text.remove_prefix(std::min(text.find_first_not_of(" ,"), text.size()));
    if (text.empty()) return shape;
    std::int64_t length = 0;
    const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), length);
    if (error != std::errc{} || length < 0) return std::nullopt;
    shape.push_back(length);
    text.remove_prefix(static_cast<std::size_t>(stop - text.data()));
  }
}

std::optional<ElementType> element_of(std::string_view type) {
  struct Known {
    std::string_view type;
    ElementType element;
  };
  constexpr std::array<Known, 7> kKnown = {{{"u1", ElementType::kU8},
                                            {"u2", ElementType::kU16},
                                            {"i2", ElementType::kI16},
                                            {"u4", ElementType::kU32},
                                            {"i4", ElementType::kI32},
                                            {"f4", ElementType::kF32},
                                            {"f8", ElementType::kF64}}};
  for (const Known& known : kKnown)
    if (type == known.type) return known.element;
  return std::nullopt;
}

class NpyFile final : public PictureFile {
 public:
  explicit NpyFile(const std::string& path) : path_(path), file_(path, std::ios::binary) {
    const std::string header = read_header();
    read_type(value_of(header, "descr"));
    if (value_of(header, "fortran_order").starts_with("True")) {
      throw Failure(path_ + " is in Fortran's order: save numpy.ascontiguousarray(frames)");
    }
    set_shape(read_shape(value_of(header, "shape")));
  }

  const PictureFormat& format() const override { return format_; }

  void read(std::int64_t frame, std::span<std::byte> pixels) override {
    file_.clear();
    file_.seekg(begin_ +
                static_cast<std::streamoff>(frame) * static_cast<std::streamoff>(pixels.size()));
    file_.read(reinterpret_cast<char*>(pixels.data()), static_cast<std::streamsize>(pixels.size()));
    if (!file_) throw Failure(path_ + " cannot be read to its end");
    if (!swapped_) return;
    const std::size_t size = bytes_of(format_.element);
    for (std::size_t i = 0; i < pixels.size(); i += size)
      std::reverse(pixels.begin() + static_cast<std::ptrdiff_t>(i),
                   pixels.begin() + static_cast<std::ptrdiff_t>(i + size));
  }

 private:
  [[noreturn]] void refuse_damaged() const { throw Failure(path_ + " is a damaged npy file"); }

  /// Returns the text of the header and leaves begin_ behind it.
  std::string read_header() {
    constexpr std::size_t kMagic = 6;
    constexpr std::uint32_t kLongest = 1 << 16;  // bytes, of a header that is not damaged
    std::array<char, kMagic + 2> magic{};
    std::array<unsigned char, 4> length_bytes{};
    file_.read(magic.data(), magic.size());
    const int length_size = magic[kMagic] == 1 ? 2 : 4;
    file_.read(reinterpret_cast<char*>(length_bytes.data()), length_size);
    std::uint32_t length = 0;
    for (std::size_t i = length_bytes.size(); i-- > 0;) length = length << 8U | length_bytes[i];
    if (!file_ || length > kLongest) refuse_damaged();
    std::string header(length, ' ');
    file_.read(header.data(), static_cast<std::streamsize>(length));
    if (!file_) refuse_damaged();
    begin_ = file_.tellg();
    return header;
  }

  void read_type(std::string_view text) {
    const std::size_t end = text.size() > 1 ? text.find('\'', 1) : std::string_view::npos;
    const std::string_view descr =
        text.starts_with('\'') && end != std::string_view::npos ? text.substr(1, end - 1) : "";
    const auto element = descr.size() > 1 ? element_of(descr.substr(1)) : std::nullopt;
    if (!element) {
      throw Failure(path_ + " holds numbers of type " +
                    (descr.empty() ? "record" : printable(descr)) +
                    ", which frames do not have: save frames.astype('uint16') or 'float32'");
    }
    constexpr char kNative = std::endian::native == std::endian::little ? '<' : '>';
    swapped_ = (descr.front() == '<' || descr.front() == '>') && descr.front() != kNative;
    format_.element = *element;
  }

  void set_shape(const std::optional<std::vector<std::int64_t>>& shape) {
    if (!shape) refuse_damaged();
    const std::size_t axes = shape->size();
    if (axes != 2 && axes != 3) {
      throw Failure(path_ + " holds an array of " + std::to_string(axes) +
                    " dimensions: frames are [rows, cols] or [frames, rows, cols]");
    }
    const std::int64_t rows = (*shape)[axes - 2];
    const std::int64_t cols = (*shape)[axes - 1];
    check_picture_size(path_, rows, cols);
    format_.rows = static_cast<int>(rows);
    format_.cols = static_cast<int>(cols);
    format_.frames = axes == 3 ? shape->front() : 1;
    const auto frame_bytes =
        static_cast<std::int64_t>(format_.pixels() * bytes_of(format_.element));
    std::error_code error;
    const auto size = std::filesystem::file_size(path_, error);
    const std::int64_t whole = error ? 0 : (static_cast<std::int64_t>(size) - begin_) / frame_bytes;
    if (format_.frames < 1 || format_.frames > whole) {
      throw Failure(path_ + " promises " + std::to_string(format_.frames) + " frames and holds " +
                    std::to_string(whole) + ": was it copied whole?");
    }
  }

  std::string path_;
  std::ifstream file_;
  std::streamoff begin_ = 0;
  bool swapped_ = false;  ///< its byte order is not the machine's
  PictureFormat format_;
};

}  // namespace

std::unique_ptr<PictureFile> open_npy(const std::string& path) {
  return std::make_unique<NpyFile>(path);
}

}  // namespace curlew
