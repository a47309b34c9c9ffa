// FitsFile: one FITS file, open for reading or being written. The only way to cfitsio.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace curlew {

/// What the pixels of an image are once BZERO and BSCALE are applied.
enum class ElementType { kU8, kI16, kU16, kI32, kU32, kF32, kF64 };

/// An image as its header describes it.
struct ImageInfo {
  ElementType element = ElementType::kU8;
  std::vector<std::int64_t> shape;  ///< slowest axis first: [frames, rows, cols]; empty: no data
  bool compressed = false;          ///< tile-compressed
  bool has_undefined = false;       ///< integer pixels equal to BLANK mean "no value"

  std::int64_t elements() const;  ///< the product of the shape; 0 where the shape is empty
};

/// A column of a new binary table.
struct ColumnSpec {
  std::string name;
  char format = 'D';  ///< K int64, J int32, D double, E float, A one character
  std::string unit;   ///< empty: none
};

/// An integer goes in as int64_t, a real number as double. NaN is written as a key without value.
using KeyValue = std::variant<bool, std::int64_t, double, std::string>;

/// Reads an existing file, or writes a new one that appears under its name only by commit().
/// Everything works on the selected HDU. Names are taken literally: `[` and `!` mean nothing.
/// Every error is a Failure that names the file. Not for two threads at once.
class FitsFile {
 public:
  /// Opens for reading. Failure: missing, a directory, empty, unreadable, not FITS, damaged.
  static FitsFile open(const std::string& path);

  /// Starts a file of another name beside it. Without commit() that is deleted and path stays
  /// untouched. Links are followed.
  static FitsFile create(const std::string& path);

  /// Starts a file that is only in memory. path: for error messages.
  static FitsFile create_in_memory(const std::string& path);

  FitsFile(FitsFile&&) noexcept;
  FitsFile& operator=(FitsFile&&) noexcept;
  ~FitsFile();

  const std::string& path() const;

  /// Writes all to disk and gives the file its name; nothing can be written after it. Failure
  /// (with nothing left behind) when the disk is full.
  void commit();

  /// The bytes of a file made by create_in_memory, as they would be on disk. They hold until the
  /// next call of anything. Selects the last HDU.
  std::span<const std::byte> memory();

  // HDUs ------------------------------------------------------------------------------------
  /// How many HDUs there are. Failure where one of their headers is cut off or damaged.
  int hdu_count();
  /// Selects by index, 0 is the primary. Failure where there are fewer.
  void select(int index);
  /// Selects by EXTNAME (case does not matter). Failure where there is none.
  void select(const std::string& name);
  /// As select, but says false where there is none or its header cannot be read.
  bool try_select(const std::string& name);
  bool try_select(int index);
  /// Whether the selected HDU is an image (tile-compressed ones are), with or without pixels.
  bool is_image();

  // Keys ------------------------------------------------------------------------------------
  // nullopt where the key is absent or has no value; Failure where the value is of another type.
  std::optional<double> key_double(const std::string& name);
  std::optional<std::int64_t> key_int(const std::string& name);
  std::optional<std::string> key_string(const std::string& name);
  /// Writes or replaces; name: at most 8 capitals, digits, '-' or '_'. The unit goes in brackets
  /// before the comment, as FITS has it. What is not ASCII becomes '?', which is all that a header
  /// may hold.
  void write_key(const std::string& name, const KeyValue& value, const std::string& comment = "",
                 const std::string& unit = "");
  /// The 80 characters of a header card.
  static std::string card(const std::string& name, std::int64_t value, const std::string& comment);

  // Images ----------------------------------------------------------------------------------
  /// The selected image. Refused before anything is allocated: sizes that overflow, a plane
  /// (the two fastest axes) larger than the machine's memory, a file shorter than its header
  /// promises (the message says what is there).
  ImageInfo image();
  /// Reads into.size() physical pixels from element `first`, in file order. NaN and infinity
  /// come as they are; undefined integer pixels are NaN where T is a floating type.
  /// T: uint8_t, int16_t, uint16_t, int32_t, uint32_t, float, double.
  template <typename T>
  void read_pixels(std::int64_t first, std::span<T> into);
  /// Appends an image HDU, all zero until written, and selects it. The first HDU of a file is
  /// the primary; a file that begins with a named image or a table gets an empty primary.
  /// shape: slowest axis first; the slowest may be 0 and grow by resize_planes.
  void create_image(ElementType element, const std::vector<std::int64_t>& shape,
                    const std::string& name = "", const std::string& unit = "");
  /// As create_image, tile-compressed without loss (Rice), a tile being a plane. Integers only; the
  /// shape is final. Where it is the file's first HDU an empty primary goes before it.
  void create_compressed_image(ElementType element, const std::vector<std::int64_t>& shape,
                               const std::string& unit = "");
  /// T as in read_pixels, converted to the image's type; Failure where a value does not fit.
  /// Writing past the end is allowed in the last HDU if resize_planes follows.
  template <typename T>
  void write_pixels(std::int64_t first, std::span<const T> pixels);
  /// Sets the length of the slowest axis, keeping the pixels of the planes that stay.
  void resize_planes(std::int64_t planes);

  // Tables ----------------------------------------------------------------------------------
  /// Appends an empty binary table and selects it.
  void create_table(const std::string& name, std::span<const ColumnSpec> columns);
  /// Failure where the file is shorter than its header promises.
  std::int64_t row_count();
  /// The rows that are really there, in a file that may be cut off; 0 where this is no table.
  std::int64_t whole_row_count();
  bool has_column(const std::string& name);
  /// Writes values from row `first_row` (0 the first); the table grows as needed.
  /// T: int32_t, int64_t, float, double.
  template <typename T>
  void write_column(const std::string& name, std::int64_t first_row, std::span<const T> values);
  /// Reads into.size() values from row `first_row`. T as in write_column, or std::string (A).
  template <typename T>
  void read_column(const std::string& name, std::int64_t first_row, std::span<T> into);

 private:
  struct Handle;
  explicit FitsFile(std::unique_ptr<Handle> handle);

  std::unique_ptr<Handle> handle_;
};

}  // namespace curlew
