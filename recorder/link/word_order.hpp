#pragma once
// How a robot lays out its registers: which way round it puts 32-bit values into two of them, and whether a documented
// address is sent minus one. All decodable evidence says low word first (CDAB) and minus one, but both are checked,
// because a wrong layout makes every float of the session nonsense.
//
// Evidence, the strongest first: values that the status answer of the same moments gives too; the robot's own address
// in registers 70-73; what temperatures, voltages, currents and hours can be.

#include <string>
#include <string_view>

#include "schema/records.hpp"

namespace tacho::recorder {

struct WordOrderGuess {
  WordOrder order = WordOrder::cdab;
  bool sure = false;             ///< false: `order` is the default, the image does not decide
  bool address_matches = false;  ///< registers 70-73 hold the robot's address
  int shift = 0;        ///< what the image calls address A is documented as A + shift; other than 0 only when shown
  bool placed = false;  ///< `shift` is shown by the robot's address or by the status answer
  std::string why;      ///< one clause with the evidence
};

struct RegisterEvidence {
  std::string_view image;   ///< one registers answer
  std::string_view peer;    ///< numeric address the connection was made to ("192.168.192.5"), may be empty
  std::string_view status;  ///< body of an 11100 answer not older than some seconds, may be empty
};

WordOrderGuess guess_word_order(const RegisterEvidence& evidence);

}  // namespace tacho::recorder
