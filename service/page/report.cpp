#include "service/page/report.h"

#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"
#include "service/page/page_files.h"

namespace curlew {
namespace {

constexpr std::size_t kMostText = 19'000'000;  // bytes of base64, beside the page itself

std::string packed(const std::string& bytes) {
  uLongf size = compressBound(bytes.size());
  std::string small(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(small.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), 6) != Z_OK)
    throw Failure("the report's frames cannot be compressed: no memory");
  small.resize(size);
  return small;
}

std::string base64(const std::string& bytes) {
  constexpr std::string_view kSigns =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned group = 0;
    for (std::size_t j = i; j < i + 3; ++j)
      group = group << 8U | (j < bytes.size() ? static_cast<unsigned char>(bytes[j]) : 0U);
    for (std::size_t j = 0; j < 4; ++j)
      text += i + j > bytes.size() ? '=' : kSigns[group >> (18U - 6U * j) & 63U];
  }
  return text;
}

/// Returns the modules as one: none of them imports or exports, and each follows what it uses.
std::string bundle() {
  std::string all;
  for (const PageFile& file : page_files()) {
    if (!file.name.ends_with(".js")) continue;
    std::string text(file.text);
    for (std::size_t at = 0; (at = text.find("import {", at)) != std::string::npos;)
      text.erase(at, text.find(";\n", at) + 2 - at);
    for (std::size_t at = 0; (at = text.find("\nexport ", at)) != std::string::npos;)
      text.erase(at + 1, std::string_view("export ").size());
    all += text;
  }
  return all;
}

std::string_view file_of(std::string_view name) {
  for (const PageFile& file : page_files())
    if (file.name == name) return file.text;
  return {};
}

void replace(std::string& text, std::string_view from, const std::string& to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos)
    throw Failure("the report's page has no " + std::string(from));  // a test sees that it has
  text.replace(at, from.size(), to);
}

/// Returns the page with its style, its program and the given data inside.
std::string page_with(const std::string& data) {
  std::string html(file_of("index.html"));
  replace(html, R"(<meta charset="utf-8">)", R"(<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'; img-src data: blob:">)");
  replace(html, R"(<link rel="icon" href="icon.svg">)", "");
  replace(html, R"(<link rel="stylesheet" href="page.css">)",
          "<style>" + std::string(file_of("page.css")) + "</style>");
  replace(html, R"(<script type="module" src="page.js"></script>)", "");
  replace(html, "</body>", data + R"(<script type="module">)" + bundle() + "</script></body>");
  return html;
}

std::string data_script(const std::string& attribute, const std::string& text) {
  return R"(<script type="text/plain" )" + attribute + ">" + text + "</script>\n";
}

/// Returns every nth frame as text, where n is the smallest power of two by which they fit.
std::vector<std::string> texts_of(const std::vector<PageMessage>& frames, std::int64_t& every) {
  for (every = 1;; every *= 2) {
    std::vector<std::string> texts;
    std::size_t size = 0;
    for (std::size_t i = 0; i < frames.size() && size <= kMostText;
         i += static_cast<std::size_t>(every)) {
      texts.push_back(base64(packed(*frames[i])));
      size += texts.back().size();
    }
    if (size <= kMostText || texts.size() <= 1) return texts;
  }
}

}  // namespace

void write_report(const std::string& path, FrameStore& store) {
  std::int64_t every = 1;
  const std::vector<std::string> texts = texts_of(store.frames(), every);
  auto status = nlohmann::ordered_json::parse(store.status());
  status["frames"] = texts.size();
  status["every"] = status["every"].get<std::int64_t>() * every;
  std::string data = data_script(R"(id="report-status")", status.dump()) +
                     data_script(R"(id="report-sensor")", base64(packed(*store.sensor(1))));
  for (const std::string& text : texts) data += data_script("data-frame", text);
  const std::string html = page_with(data);
  const std::string target = replaceable_target(path);
  const std::string partial = partial_path(target);
  std::ofstream file(partial, std::ios::binary);
  file << html;
  file.close();
  std::error_code error;
  if (file) std::filesystem::rename(partial, target, error);
  if (file && !error) return;
  std::filesystem::remove(partial, error);
  throw Failure(path + " cannot be written: is the folder there, and room on the disk?");
}

}  // namespace curlew
