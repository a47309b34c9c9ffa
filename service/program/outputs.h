// Protects what is there from the outputs of a run.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Says what happens to a file that an output of this run would replace.
enum class Existing {
  kRefused,
  kReplaced,  ///< The user gave --force.
};

/// Checks the name of a file that will appear whole, before the run begins. Throws UsageError if it
/// is one of the inputs, by whatever path, or if it exists and is not to be replaced; Failure if it
/// names what is never replaced, such as a device. An empty output is none.
void check_output(const std::string& output, const std::vector<std::string>& inputs,
                  Existing existing);

/// As check_output, for an output that may also be a pipe, a character device or standard output.
void check_stream_output(const std::string& output, const std::vector<std::string>& inputs,
                         Existing existing);

/// Says whether the path names a pipe or a character device, which is written and not replaced.
bool is_stream(const std::string& path);

/// Says whether an output is "-" or /dev/stdout.
bool is_standard_output(const std::string& output);

/// Returns a new descriptor for standard output. What the program prints goes to standard error
/// from then on. Throws Failure if there is no descriptor left.
int take_standard_output();

/// Lets standard output wait for its reader only until SIGINT or SIGTERM. After that printing fails
/// where nobody reads it.
void make_standard_output_interruptible();

/// Says a sentence on standard error. It is lost where nobody reads it when SIGINT or SIGTERM
/// comes.
void complain(const std::string& sentence);

/// Puts /dev/null where standard input, output or error are closed. Otherwise the next file that is
/// opened would get their numbers, and what is printed would go into it.
void fill_standard_descriptors();

}  // namespace curlew
