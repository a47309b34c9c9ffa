// One request is read from bytes that anybody may send.
#include "service/http/http_request.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

const std::string kPost =
    "POST /control?a=1&b=two HTTP/1.1\r\nHost: here:1\r\nCONTENT-length: 3\r\n\r\nabcGET /";

TEST(HttpRequests, AreReadWithTheirBodyAndNoMore) {
  const ParsedRequest parsed = parse_request(kPost);
  ASSERT_EQ(parsed.state, HttpParse::kComplete);
  EXPECT_EQ(parsed.used, kPost.size() - 5);
  EXPECT_EQ(parsed.request.method, "POST");
  EXPECT_EQ(parsed.request.path, "/control");
  EXPECT_EQ(parsed.request.asked("a"), "1");
  EXPECT_EQ(parsed.request.asked("b"), "two");
  EXPECT_EQ(parsed.request.asked("c"), "");
  EXPECT_EQ(parsed.request.header("host"), "here:1");
  EXPECT_EQ(parsed.request.body, "abc");
}

TEST(HttpRequests, AreIncompleteUpToTheirLastByte) {
  for (std::size_t size = 0; size < kPost.size() - 5; ++size)
    ASSERT_EQ(parse_request(kPost.substr(0, size)).state, HttpParse::kIncomplete) << size;
}

TEST(HttpRequests, ThatAreNotPlainAreRefused) {
  const auto state = [](const std::string& first, const std::string& headers = "") {
    return parse_request(first + "\r\n" + headers + "\r\n").state;
  };
  for (const char* first : {"", "GET", "GET /", "GET / HTTP/2", "GET x HTTP/1.1", " / HTTP/1.1",
                            "GET  / HTTP/1.1", "G\tT / HTTP/1.1", "GET /\x80 HTTP/1.1"})
    EXPECT_EQ(state(first), HttpParse::kBad) << first;
  for (const char* header :
       {"no colon\r\n", ": x\r\n", "a b: c\r\n", "Content-Length: \r\n", "Content-Length: -1\r\n",
        "Content-Length: 1x\r\n", "Content-Length: 0\r\nContent-Length: 0\r\n",
        "Content-Length: 99999999999999999999999\r\n", "Transfer-Encoding: chunked\r\n"})
    EXPECT_EQ(state("GET / HTTP/1.1", header), HttpParse::kBad) << header;
  EXPECT_EQ(state("GET / HTTP/1.1", "Content-Length: 4097\r\n"), HttpParse::kTooLong);
  EXPECT_EQ(parse_request(std::string(kLongestHead, 'x')).state, HttpParse::kTooLong);
}

}  // namespace
}  // namespace curlew
