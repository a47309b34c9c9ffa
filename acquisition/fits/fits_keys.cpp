// This file holds what FitsFile does with header keys.
#include <fitsio.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"

namespace curlew {
namespace {

std::string printable_ascii(std::string text) {
  for (char& c : text) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text;
}

// Writes a number in 15 digits, or in 17 if 15 do not read back as the same number.
std::string key_text(double value) {
  std::array<char, 40> digits{};
  for (const int precision : {15, 17}) {
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value,
                                   std::chars_format::general, precision);
    double back = 0.0;
    std::from_chars(digits.data(), end.ptr, back);
    if (back == value || precision == 17) {
      std::string text(digits.data(), end.ptr);
      for (char& c : text) {
        if (c == 'e') c = 'E';
      }
      // Others would read a number without point or exponent as an integer.
      if (text.find_first_of(".E") == std::string::npos) text += '.';
      return text;
    }
  }
  return {};
}

bool is_absent(int status) {
  if (status != KEY_NO_EXIST && status != VALUE_UNDEFINED) return false;
  fits_clear_errmsg();
  return true;
}

}  // namespace

CardValue FitsFile::Handle::key_value(const std::string& name) {
  std::array<char, FLEN_CARD> text{};
  int status = 0;
  fits_read_card(cfits(file), name.c_str(), text.data(), &status);
  if (is_absent(status)) return {};
  check(status, "read the key " + name);
  card = text.data();
  return card_value(card);
}

std::optional<double> FitsFile::key_double(const std::string& name) {
  const CardValue value = handle_->key_value(name);
  if (value.kind == CardKind::kNone) return std::nullopt;
  const auto number = real_of(value);
  if (!number) handle_->fail("cannot be used: cannot read the key " + name + " as a number");
  return number;
}

std::optional<std::int64_t> FitsFile::key_int(const std::string& name) {
  const CardValue value = handle_->key_value(name);
  if (value.kind == CardKind::kNone) return std::nullopt;
  const auto number = integer_of(value);
  if (!number) handle_->fail("cannot be used: cannot read the key " + name + " as an integer");
  return number;
}

std::optional<std::string> FitsFile::key_string(const std::string& name) {
  int status = 0;
  char* value = nullptr;
  fits_read_key_longstr(cfits(handle_->file), name.c_str(), &value, nullptr, &status);
  if (is_absent(status)) return std::nullopt;
  handle_->check(status, "read the key " + name + " as a string");
  std::string text = value == nullptr ? "" : value;
  fits_free_memory(value, &status);
  return printable_ascii(text);
}

void FitsFile::write_history(const std::string& line) {
  int status = 0;
  fits_write_history(cfits(handle_->file), printable_ascii(line).c_str(), &status);
  handle_->check(status, "write HISTORY");
}

std::vector<std::string> FitsFile::history() {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  int cards = 0;
  fits_get_hdrspace(file, &cards, nullptr, &status);
  std::vector<std::string> lines;
  for (int n = 1; n <= cards && status == 0; ++n) {
    std::array<char, FLEN_CARD> card{};
    fits_read_record(file, n, card.data(), &status);
    const std::string text = card.data();
    if (text.rfind("HISTORY ", 0) == 0) lines.push_back(text.substr(8));
  }
  handle_->check(status, "read HISTORY");
  return lines;
}

void FitsFile::write_key(const std::string& name, const KeyValue& value, const std::string& comment,
                         const std::string& unit) {
  int status = 0;
  fitsfile* file = cfits(handle_->file);
  const std::string note = printable_ascii(unit.empty() ? comment : "[" + unit + "] " + comment);
  if (const auto* flag = std::get_if<bool>(&value)) {
    fits_update_key_log(file, name.c_str(), *flag ? 1 : 0, note.c_str(), &status);
  } else if (const auto* integer = std::get_if<std::int64_t>(&value)) {
    fits_update_key_lng(file, name.c_str(), *integer, note.c_str(), &status);
  } else if (const auto* text = std::get_if<std::string>(&value)) {
    fits_update_key_longstr(file, name.c_str(), printable_ascii(*text).c_str(), note.c_str(),
                            &status);
  } else if (const double real = std::get<double>(value); !std::isfinite(real)) {
    fits_update_key_null(file, name.c_str(), note.c_str(), &status);
  } else {
    std::string record = name;
    record.resize(8, ' ');
    std::string number = key_text(real);
    if (number.size() < 20) number.insert(0, 20 - number.size(), ' ');
    record += "= " + number + " / " + note;
    record.resize(80, ' ');
    fits_update_card(file, name.c_str(), record.c_str(), &status);
  }
  handle_->check(status, "write the key " + name);
}

}  // namespace curlew
