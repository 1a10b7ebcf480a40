FROM python:3.11-slim-bookworm

# pybullet, embreex, rasterio and the other wheels bring what they need; nothing is compiled here, and the
# pinned torch is the CPU build
RUN useradd --create-home --uid 1000 covernav && install -d -o covernav /workspace
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY app app
COPY planner planner
COPY scenes scenes
COPY static static
RUN pip install --no-cache-dir --disable-pip-version-check . && rm -rf /src

USER covernav
WORKDIR /workspace
ENV NUMBA_CACHE_DIR=/tmp/numba
VOLUME /workspace
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=30s \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/healthz', timeout=2)"]
ENTRYPOINT ["covernav"]
CMD ["serve", "--host", "0.0.0.0", "--port", "8000", "--workspace", "/workspace"]
