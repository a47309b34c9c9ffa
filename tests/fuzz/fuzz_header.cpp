// Headers: card values and the check of cards, and what passes it is opened by cfitsio.
#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/header_check.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  RawHeader header{.end = RawHeader::End::kComplete};
  header.cards.assign(reinterpret_cast<const char*>(bytes), size / 80 * 80);
  if (header.size() == 0 || find_header_fault(header)) return 0;
  std::string text = header.cards;
  text.append("END").resize((text.size() + 2879) / 2880 * 2880, ' ');
  text.append(2880, '\0');
  const FuzzFile file(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  refuse_or([&] {
    FitsFile fits = FitsFile::open(file.path());
    if (fits.is_image()) fits.image();
    for (std::size_t i = 0; i < header.size(); ++i) {
      const std::string name(card_name(header.card(i)));
      if (name.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") != std::string::npos)
        continue;
      refuse_or([&] { fits.key_int(name); });
      refuse_or([&] { fits.key_double(name); });
      refuse_or([&] { fits.key_string(name); });
    }
  });
  return 0;
}
