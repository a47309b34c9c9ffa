// These types own Aravis' objects and errors. Only files in acquisition/aravis/ include this one.
#pragma once

#include <arv.h>

#include <memory>
#include <string>

namespace curlew {

struct GObjectUnref {
  void operator()(gpointer object) const noexcept { g_object_unref(object); }
};
template <typename Object>
using GObjectPtr = std::unique_ptr<Object, GObjectUnref>;

struct GFree {
  void operator()(gpointer memory) const noexcept { g_free(memory); }
};
/// Owns an array, but not what its elements point to.
template <typename Element>
using GArrayPtr = std::unique_ptr<Element[], GFree>;

/// Holds an error of Aravis: pass out() to a call, then ask.
class AravisError {
 public:
  AravisError() = default;
  AravisError(const AravisError&) = delete;
  AravisError& operator=(const AravisError&) = delete;
  ~AravisError() { g_clear_error(&error_); }

  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  std::string text() const { return error_ != nullptr ? error_->message : std::string(); }

 private:
  GError* error_ = nullptr;
};

/// Turns the null that Aravis returns for a text it does not have into an empty text.
inline std::string text_or_empty(const char* text) { return text != nullptr ? text : ""; }

}  // namespace curlew
