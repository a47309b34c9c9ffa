#include "service/page/page_server.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <fstream>

#include "core/error.h"
#include "service/page/page_files.h"

namespace curlew {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kShortestToken = 16;
// A frame of a replay that does not exist is not waited for longer than this.
constexpr milliseconds kMaxFrameWait{2000};

const char* const kHeaders =
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "Referrer-Policy: no-referrer\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Cache-Control: no-store\r\n";

/// Reads the token; nothing where there is no file.
std::string read_token(const std::string& path) {
  std::string token;
  if (path.empty()) return token;
  std::ifstream file(path);
  file >> token;
  const bool plain =
      std::ranges::all_of(token, [](unsigned char c) { return std::isalnum(c) != 0; });
  if (token.size() < kShortestToken || !plain)
    throw UsageError("page.token_file " + path +
                     " must hold at least 16 letters and digits: `openssl rand -hex 16 >FILE` "
                     "makes it");
  return token;
}

/// Compares in a time that does not depend on where the two differ.
bool same(std::string_view a, std::string_view b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    difference |=
        static_cast<unsigned>(static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]));
  return difference == 0;
}

/// Returns the value of a cookie; empty where there is none.
std::string cookie(const HttpRequest& request, const std::string& name) {
  const std::string all = "; " + request.header("cookie");
  const std::size_t start = all.find("; " + name + "=");
  if (start == std::string::npos) return {};
  const std::size_t value = start + name.size() + 3;
  return all.substr(value, std::min(all.find(';', value), all.size()) - value);
}

/// Returns whether a request was sent to this machine by the name of this machine. A page of a
/// stranger whose name leads here, by DNS, has that name in its requests.
bool is_for_loopback(const HttpRequest& request) {
  const auto is_of = [](std::string_view text, std::string_view signs) {
    return text.find_first_not_of(signs) == std::string_view::npos;
  };
  std::string name = request.header("host");
  const std::size_t colon = std::min(name.rfind(':'), name.size());
  if (is_of(std::string_view(name).substr(std::min(colon + 1, name.size())), "0123456789"))
    name.resize(colon);
  return name == "localhost" || name == "[::1]" ||
         (name.rfind("127.", 0) == 0 && is_of(name, "0123456789."));
}

/// Returns whether a page of this server sent the request, and no page of a stranger.
bool is_of_this_page(const HttpRequest& request) {
  const std::string site = request.header("sec-fetch-site");
  return request.header("origin") == "http://" + request.header("host") &&
         (site.empty() || site == "same-origin");
}

std::optional<std::int64_t> number_of(const std::string& text) {
  std::int64_t number = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  if (text.empty() || error != std::errc{} || stop != end) return std::nullopt;
  return number;
}

const char* type_of(std::string_view file) {
  const std::string_view ending = file.substr(std::min(file.rfind('.'), file.size()));
  if (ending == ".js") return "text/javascript; charset=utf-8";
  if (ending == ".css") return "text/css; charset=utf-8";
  if (ending == ".svg") return "image/svg+xml";
  return "text/html; charset=utf-8";
}

HttpAnswer good(const char* type, PageMessage body) {
  HttpAnswer answer;
  answer.content_type = type;
  answer.body = std::move(body);
  return answer;
}

HttpAnswer file_answer(const std::string& path) {
  const std::string name = path == "/" ? "index.html" : path.substr(1);
  for (const PageFile& file : page_files())
    if (file.name == name)
      return good(type_of(name), std::make_shared<const std::string>(file.text));
  return plain_answer(404, "there is no " + path + " here\n");
}

}  // namespace

PageServer::PageServer(const PageOptions& options, PageSource& source, PageControl control)
    : listen_(options.listen),
      token_(read_token(options.token_file)),
      source_(source),
      control_(std::move(control)),
      server_({"page", options.listen, !token_.empty(), "set token_file"},
              [this](const HttpRequest& request, milliseconds waited) {
                std::optional<HttpAnswer> made = answer(request, waited);
                if (made) {
                  made->headers += kHeaders;
                  made->keep_open = made->status == 200;
                }
                return made;
              }) {}

std::string PageServer::url() const {
  return "http://" + listen_.substr(0, listen_.rfind(':')) + ":" + std::to_string(server_.port()) +
         "/" + (token_.empty() ? "" : "?token=TOKEN");
}

bool PageServer::may_see(const HttpRequest& request) const {
  if (token_.empty()) return is_for_loopback(request);
  return same(cookie(request, "curlew"), token_) ||
         (request.path == "/" && same(request.asked("token"), token_));
}

std::optional<HttpAnswer> PageServer::answer(const HttpRequest& request,
                                             milliseconds waited) const {
  if (!may_see(request))
    return plain_answer(
        403, token_.empty()
                 ? "ask for this page as localhost or 127.0.0.1\n"
                 : "this page needs its token: http://ADDRESS/?token=TOKEN, with that of "
                   "token_file in section [page]\n");
  if (request.method == "POST" && request.path == "/control") return change(request);
  if (request.method != "GET" && request.method != "HEAD")
    return plain_answer(405, "only GET is answered\n");
  return show(request, waited);
}

std::optional<HttpAnswer> PageServer::show(const HttpRequest& request, milliseconds waited) const {
  // Who asks for the same over and over would take the processor from the frame path.
  const bool of_source =
      request.path == "/status" || request.path == "/sensor" || request.path == "/frame";
  if (of_source && request.since_answer + waited < source_.between_frames()) return std::nullopt;
  if (request.path == "/status")
    return good("application/json", std::make_shared<const std::string>(source_.status()));
  if (request.path == "/sensor" || request.path == "/frame") {
    const auto number = number_of(request.asked("number"));
    if (!number) return plain_answer(400, request.path + " needs ?number=N\n");
    PageMessage message =
        request.path == "/sensor" ? source_.sensor(*number) : source_.frame(*number, waited);
    if (message) return good("application/octet-stream", std::move(message));
    if (request.path == "/frame" && waited < kMaxFrameWait) return std::nullopt;
    return plain_answer(404, "there is no such number\n");
  }
  HttpAnswer made = file_answer(request.path);
  if (!token_.empty() && request.path == "/")
    made.headers = "Set-Cookie: curlew=" + token_ + "; HttpOnly; SameSite=Strict; Path=/\r\n";
  return made;
}

HttpAnswer PageServer::change(const HttpRequest& request) const {
  if (!control_)
    return plain_answer(403, "the page may change nothing: set control = true in section [page]\n");
  if (!is_of_this_page(request))
    return plain_answer(403, "only this page itself may ask for changes\n");
  if (const std::string why = control_(request.body, request.peer); !why.empty())
    return plain_answer(400, why + "\n");
  return plain_answer(200, "done\n");
}

}  // namespace curlew
