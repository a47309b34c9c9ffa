// A FitsFile is one FITS file, open for reading or being written. It is the only way to cfitsio.
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

/// Says what the pixels of an image are once BZERO and BSCALE are applied.
enum class ElementType { kU8, kI16, kU16, kI32, kU32, kF32, kF64 };

/// Describes an image as its header does.
struct ImageInfo {
  ElementType element = ElementType::kU8;
  /// Slowest axis first: [frames, rows, cols]; empty if there are no data.
  std::vector<std::int64_t> shape;
  bool compressed = false;     ///< whether it is tile-compressed
  bool has_undefined = false;  ///< integer pixels equal to BLANK mean "no value"

  std::int64_t elements() const;  ///< the product of the shape; 0 if the shape is empty
};

/// Describes a column of a new binary table.
struct ColumnSpec {
  std::string name;
  char format = 'D';  ///< K int64, J int32, D double, E float, A one character
  std::string unit;   ///< empty if there is none
};

enum class RecordKind : std::uint8_t { kText, kInteger, kReal, kList };

/// Describes a column of a table of one row, and its cell. A value of another kind, as an empty
/// one, is none: an empty text or list, NaN, or kNoInteger.
struct RecordField {
  std::string name;
  RecordKind kind = RecordKind::kReal;
  std::string unit;  ///< empty if there is none
  std::variant<std::monostate, std::string, std::int64_t, double, std::vector<double>> value;
};
inline constexpr std::int64_t kNoInteger = -32768;

/// An integer goes in as int64_t, a real number as double. NaN is written as a key without value.
using KeyValue = std::variant<bool, std::int64_t, double, std::string>;

/// Reads an existing file, or writes a new one that appears under its name only by commit().
/// Everything works on the selected HDU. Names are taken literally: `[` and `!` mean nothing. Every
/// error is a Failure that names the file. Two threads must not use one at once.
class FitsFile {
 public:
  /// Opens a file for reading, one packed by gzip too. Throws Failure if it is missing, a
  /// directory, empty, unreadable, not FITS, or if the header of one of its HDUs is damaged: what
  /// cfitsio would trust is checked before (header_check.h).
  static FitsFile open(const std::string& path);

  /// Starts a file of another name beside `path`. Without commit() that file is deleted and `path`
  /// stays untouched. Links are followed. Only a regular file is ever replaced: throws Failure for
  /// a device, a pipe, a socket, a directory, and a link that leads nowhere.
  static FitsFile create(const std::string& path);

  /// Starts a file that is only in memory. path: what error messages call it.
  static FitsFile create_in_memory(const std::string& path);

  FitsFile(FitsFile&&) noexcept;
  FitsFile& operator=(FitsFile&&) noexcept;
  ~FitsFile();

  const std::string& path() const;

  /// Writes all to disk and gives the file its name; nothing can be written after it. Throws
  /// Failure, and leaves nothing behind, when the disk is full.
  void commit();

  /// Returns the bytes of a file made by create_in_memory, as they would be on disk. They are valid
  /// until the next call of any function. Selects the last HDU.
  std::span<const std::byte> memory();

  // HDUs ------------------------------------------------------------------------------------
  /// Returns how many HDUs there are. Throws Failure if one of their headers is cut off or damaged.
  int hdu_count();
  /// Selects an HDU by its index; 0 is the primary. Throws Failure if there are fewer.
  void select(int index);
  /// Selects an HDU by its EXTNAME, whose case does not matter. Throws Failure if there is none.
  void select(const std::string& name);
  /// As select, but returns false if there is no such HDU or its header cannot be read.
  bool try_select(const std::string& name);
  bool try_select(int index);
  /// Says whether the selected HDU is an image (a tile-compressed one is), with or without pixels.
  bool is_image();

  // These return nullopt if the key is absent or has no value. They throw Failure if the value is
  // of another type. In a text, what is no printable ASCII becomes '?'.
  std::optional<double> key_double(const std::string& name);
  std::optional<std::int64_t> key_int(const std::string& name);
  std::optional<std::string> key_string(const std::string& name);
  /// Writes or replaces a key. name: at most 8 capitals, digits, '-' or '_'. The unit goes in
  /// brackets before the comment, as FITS has it. A header may hold only ASCII, so any other
  /// character becomes '?'.
  void write_key(const std::string& name, const KeyValue& value, const std::string& comment = "",
                 const std::string& unit = "");
  /// Appends a HISTORY card, or as many as the line takes.
  void write_history(const std::string& line);
  /// Returns the texts of the HISTORY cards.
  std::vector<std::string> history();
  /// Returns the 80 characters of a header card.
  static std::string card(const std::string& name, std::int64_t value, const std::string& comment);

  // Images ----------------------------------------------------------------------------------
  /// Describes the selected image. Throws Failure, before anything is allocated, for sizes that
  /// overflow, for a plane (the two fastest axes) that exceeds memory_limit_bytes(), and for a file
  /// shorter than its header promises (the message says what is there).
  ImageInfo image();
  /// Reads into.size() physical pixels from element `first`, in file order. NaN and infinity come
  /// as they are; undefined integer pixels become NaN if T is a floating type. T: uint8_t, int16_t,
  /// uint16_t, int32_t, uint32_t, float, double. Compressed pixels are read in another process
  /// (unpacking_process.h).
  template <typename T>
  void read_pixels(std::int64_t first, std::span<T> into);
  /// Appends an image HDU, all zero until written, and selects it. The first HDU of a file is
  /// the primary; a file that begins with a named image or a table gets an empty primary.
  /// shape: slowest axis first; the slowest may be 0 and grow by resize_planes.
  void create_image(ElementType element, const std::vector<std::int64_t>& shape,
                    const std::string& name = "", const std::string& unit = "");
  /// As create_image, but tile-compressed without loss (Rice), one tile per plane. It takes
  /// integers only, and the shape is final. If it is the file's first HDU, an empty primary goes
  /// before it.
  void create_compressed_image(ElementType element, const std::vector<std::int64_t>& shape,
                               const std::string& unit = "");
  /// Writes pixels from element `first` on. T is as in read_pixels; the values are converted to the
  /// image's type. Throws Failure if a value does not fit. Writing past the end is allowed in the
  /// last HDU if resize_planes follows.
  template <typename T>
  void write_pixels(std::int64_t first, std::span<const T> pixels);
  /// Sets the length of the slowest axis, keeping the pixels of the planes that stay.
  void resize_planes(std::int64_t planes);

  // Tables ----------------------------------------------------------------------------------
  /// Appends an empty binary table and selects it.
  void create_table(const std::string& name, std::span<const ColumnSpec> columns);
  /// Appends a table of one row, or of none, and selects it. Lists have any length.
  void create_record(const std::string& name, std::span<const RecordField> fields, bool with_row);
  /// Returns the number of rows. Throws Failure if the file is shorter than its header promises.
  std::int64_t row_count();
  /// Returns the number of rows that are really there, in a file that may be cut off; 0 if this is
  /// no table.
  std::int64_t whole_row_count();
  bool has_column(const std::string& name);
  /// Writes values from row `first_row` on, where 0 is the first; the table grows as needed. T:
  /// int32_t, int64_t, float, double.
  template <typename T>
  void write_column(const std::string& name, std::int64_t first_row, std::span<const T> values);
  /// Writes whole rows, as FITS has their bytes, from row `first_row` on; the table grows as
  /// needed.
  void write_rows(std::int64_t first_row, std::span<const std::byte> rows);
  /// Reads into.size() values from row `first_row` on. T is as in write_column, or std::string for
  /// a column of format A.
  template <typename T>
  void read_column(const std::string& name, std::int64_t first_row, std::span<T> into);

 private:
  struct Handle;
  explicit FitsFile(std::unique_ptr<Handle> handle);

  std::unique_ptr<Handle> handle_;
};

}  // namespace curlew
