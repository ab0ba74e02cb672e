// The connection to the program that started Gazebo.
#pragma once

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <vector>

namespace adrl {

[[noreturn]] inline void end(const char *why) {
    if (why) std::fprintf(stderr, "adrl lockstep: %s\n", why);
    _exit(why ? 1 : 0);
}

// Blocking reads and writes of whole numbers and texts.
class Line {
  public:
    void connect(int port) {
        socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<std::uint16_t>(port));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        if (::connect(socket_, reinterpret_cast<sockaddr *>(&address), sizeof address) != 0) end("nobody listens");
        const int on = 1;
        setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    }

    void read(void *into, std::size_t bytes) {
        for (auto *at = static_cast<char *>(into); bytes > 0;) {
            const ssize_t got = ::recv(socket_, at, bytes, 0);
            if (got < 0 && errno == EINTR) continue;
            if (got <= 0) end(nullptr); // the other side has gone
            at += got;
            bytes -= static_cast<std::size_t>(got);
        }
    }

    template <typename T> T read() {
        T value;
        read(&value, sizeof value);
        return value;
    }

    void write(const std::vector<char> &data) {
        for (std::size_t sent = 0; sent < data.size();) {
            const ssize_t n = ::send(socket_, data.data() + sent, data.size() - sent, MSG_NOSIGNAL);
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) end(nullptr);
            sent += static_cast<std::size_t>(n);
        }
    }

  private:
    int socket_ = -1;
};

} // namespace adrl
