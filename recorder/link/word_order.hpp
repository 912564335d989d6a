#pragma once
// Which way round a robot puts 32-bit values into two registers. All decodable evidence says low word first (CDAB), but
// it is checked once per session, because a wrong order makes every float of the session nonsense.

#include <string>
#include <string_view>

#include "schema/records.hpp"

namespace tacho::recorder {

struct WordOrderGuess {
  WordOrder order = WordOrder::cdab;
  bool sure = false;             ///< false: `order` is the default, the image does not decide
  bool address_matches = false;  ///< registers 70-73 hold the robot's address: addressing is right
  std::string why;               ///< one clause with the evidence
};

/// `image`: one registers answer. `peer`: numeric address the connection was made to ("192.168.192.5"), may be empty.
WordOrderGuess guess_word_order(std::string_view image, std::string_view peer);

}  // namespace tacho::recorder
